// Times of the passes over a run, and the table of them.
#pragma once

#include <iosfwd>
#include <map>
#include <ostream>
#include <string>
#include <vector>

#include "fastibl/core/clock.h"

namespace fastibl::demo {

class Timings {
 public:
  void add(const std::map<std::string, double>& seconds);  // of one frame, as Session gives them
  void add(const std::string& part, double seconds);       // of the program's own work
  void count_frame();                                      // a frame was shown or stored

  // One line per pass: the number of runs, median and 95th percentile in milliseconds. Then frames
  // per second, and the processor time that the whole program takes for one frame.
  void print(std::ostream& out) const;
  // The passes in the order in which they run, then the session's "total", then the program's own
  // parts.
  std::vector<std::string> order() const;
  double recent(const std::string& part) const;  // median of the last ones, ms; 0 before any
  double frames_per_second() const;              // of the last ones, in wall clock time

 private:
  std::map<std::string, std::vector<double>> seconds_;
  std::vector<std::string> own_;
  std::vector<double> shown_;  // seconds
  std::vector<double> used_;   // processor time at that moment, seconds
  Stopwatch clock_;
  ProcessorClock processor_;
};

}  // namespace fastibl::demo
