// Times of the passes over a run, and the table of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <iosfwd>
#include <map>
#include <ostream>
#include <string>
#include <vector>

#include "fastibl/core/clock.h"

namespace fastibl::demo {

// A program may run for months: of each pass, the times of the last kKept runs are kept.
class Timings {
 public:
  static constexpr std::size_t kKept = 10'000;

  void add(const std::map<std::string, double>& seconds);  // of one frame, as Session gives them
  void add(const std::string& part, double seconds);       // of the program's own work
  void count_frame();                                      // a frame was shown or stored

  // One line per pass: the number of runs, and median and 95th percentile of those that are kept,
  // in milliseconds. Then frames per second, and the processor time that the whole program takes
  // for one frame.
  void print(std::ostream& out) const;
  // The passes in the order in which they run, then the session's "total", then the program's own
  // parts.
  std::vector<std::string> order() const;
  double recent(const std::string& part) const;  // median of the last ones, ms; 0 before any
  double frames_per_second() const;              // of the last ones, in wall clock time

 private:
  struct Runs {
    void add(double seconds);
    std::int64_t count = 0;
    double sum = 0;           // seconds, of all
    std::deque<double> last;  // seconds
  };
  struct Moment {
    double shown, used;  // seconds; `used`: processor time
  };
  std::map<std::string, Runs> runs_;
  std::vector<std::string> own_;
  std::int64_t frames_ = 0;
  std::vector<Moment> first_;  // of the first frames
  std::deque<Moment> last_;    // and of the last ones
  Stopwatch clock_;
  ProcessorClock processor_;
};

}  // namespace fastibl::demo
