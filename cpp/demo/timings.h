// Times of the passes over a run, and the table of them.
#pragma once

#include <iosfwd>
#include <map>
#include <string>
#include <vector>

namespace fastibl::demo {

class Timings {
 public:
  void add(const std::map<std::string, double>& seconds);  // of one frame, as a Session gives them
  // One line a pass: runs, median and 95th percentile in milliseconds; then frames a second.
  void print(std::ostream& out) const;
  double recent_milliseconds() const;  // median total of the last frames; 0 before the first

 private:
  std::map<std::string, std::vector<double>> seconds_;
};

}  // namespace fastibl::demo
