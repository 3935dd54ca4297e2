// Wall time for the timings that a Session reports.
#pragma once

#include <chrono>
#include <ctime>

namespace fastibl {

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// CPU time: of the whole process, with all threads, or of this thread alone where the system tells
// it.
class ProcessorClock {
 public:
  enum class Of { process, thread };
  explicit ProcessorClock(Of of = Of::process) : of_(of), start_(now()) {}
  double seconds() const { return now() - start_; }

 private:
  double now() const {
#ifdef CLOCK_THREAD_CPUTIME_ID
    timespec t;
    if (of_ == Of::thread && clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t) == 0)
      return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
#endif
    return double(std::clock()) / CLOCKS_PER_SEC;
  }

  Of of_;
  double start_;
};

}  // namespace fastibl
