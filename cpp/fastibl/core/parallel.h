// A parallel loop over a small pool of std::thread. Work is cut into the same blocks for any number
// of threads, so results are the same bits as long as a block depends on its own index alone.
#pragma once

#include <functional>

namespace fastibl {

// Number of threads that parallel_for uses, the caller's among them. 0, as it is at first: one a
// core that this process may use. The first loop starts them, and they stay until a call with 1, as
// before a plugin is unloaded. set_threads is not to be called from inside a parallel_for.
void set_threads(int count);
int threads();

// Calls body(begin, end) for consecutive blocks of at most `grain` indices of [0, count) and waits.
// The first exception thrown by a body is rethrown here. Nested calls run in the calling thread.
void parallel_for(int count, int grain, const std::function<void(int begin, int end)>& body);

// While it lives, loops of its thread run in that thread alone: several share the work sooner, but
// spend more processor time in all. together: as ever, within another one's life.
class OneThread {
 public:
  enum class Loops { alone, together };
  explicit OneThread(Loops loops);
  ~OneThread();
  OneThread(const OneThread&) = delete;
  OneThread& operator=(const OneThread&) = delete;

 private:
  bool before_;
};

}  // namespace fastibl
