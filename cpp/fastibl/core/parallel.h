// A parallel loop over a small pool of std::thread. Work is cut into the same blocks for any number
// of threads, so results are the same bits as long as a block depends only on its own index.
#pragma once

#include <functional>

namespace fastibl {

// Number of threads that parallel_for uses, including the caller's. 0, the initial setting: one for
// each core that this process may use. The first loop starts them, and they stay until a call with
// 1, as before a plugin is unloaded. set_threads must not be called from inside a parallel_for.
void set_threads(int count);
int threads();

// Calls body(begin, end) for consecutive blocks of at most `grain` indices of [0, count) and waits.
// The first exception thrown by a body is rethrown here. Nested calls run in the calling thread.
void parallel_for(int count, int grain, const std::function<void(int begin, int end)>& body);

// While it lives, loops of its thread run in that thread alone: several threads finish the work
// sooner, but spend more processor time in all. together: loops run as usual again, within the life
// of another OneThread.
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
