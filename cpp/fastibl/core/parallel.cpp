#include "fastibl/core/parallel.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

#if defined(__x86_64__) || defined(__i386__)
#include <immintrin.h>
#endif
#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#endif
#if defined(__linux__)
#include <sched.h>
#endif

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// Pauses in a waiting loop, which leaves the core to its other thread meanwhile.
inline void relax() {
#if defined(__x86_64__) || defined(__i386__)
  _mm_pause();
#endif
}

thread_local bool inside_loop = false;
thread_local bool alone = false;  // see OneThread

struct Job {
  Job(const std::function<void(int, int)>& f, int n, int g) : body(&f), count(n), grain(g) {}

  const std::function<void(int, int)>* body;
  int count, grain;
  std::atomic<std::int64_t> next{0};  // may exceed count by a grain per thread
  std::mutex failure_mutex;
  std::exception_ptr failure;

  void work() {
    inside_loop = true;
    for (std::int64_t begin; (begin = next.fetch_add(grain)) < count;) {
      try {
        (*body)(int(begin), int(std::min<std::int64_t>(begin + grain, count)));
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (!failure) failure = std::current_exception();
      }
    }
    inside_loop = false;
  }
};

// How long the caller watches for the end of a loop before it sleeps: being woken takes as long.
constexpr std::chrono::microseconds kPatience{50};

class Pool {
 public:
  explicit Pool(int helpers) {
    try {
      for (int i = 0; i < helpers; ++i) workers_.emplace_back([this] { serve(); });
    } catch (const std::system_error&) {  // as many as the system gives
    }
  }
  ~Pool() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
    for (std::thread& worker : workers_) worker.join();
  }
  int size() const { return int(workers_.size()) + 1; }

  // Waits for the helpers that have joined, not for those that are still waking.
  void run(Job& job) {
    const int helpers = std::min(int(workers_.size()), (job.count - 1) / job.grain);
    {
      const std::lock_guard lock(mutex_);
      job_ = &job;
      open_ = helpers;
    }
    for (int i = 0; i < helpers; ++i) wake_.notify_one();
    job.work();
    {
      const std::lock_guard lock(mutex_);
      open_ = 0;  // from here on nobody joins
    }
    const auto end = std::chrono::steady_clock::now() + kPatience;
    do {
      if (helping_ == 0) return;
      relax();
    } while (std::chrono::steady_clock::now() < end);
    std::unique_lock lock(mutex_);
    idle_.wait(lock, [this] { return helping_ == 0; });
  }

 private:
  void serve() {
    while (true) {
      Job* job = nullptr;
      {
        std::unique_lock lock(mutex_);
        wake_.wait(lock, [this] { return stop_ || open_ > 0; });
        if (stop_) return;
        job = job_;
        --open_, ++helping_;
      }
      job->work();
      const std::lock_guard lock(mutex_);
      if (--helping_ == 0) idle_.notify_one();
    }
  }

  std::vector<std::thread> workers_;
  std::mutex mutex_;  // what follows is changed only under it
  std::condition_variable wake_, idle_;
  Job* job_ = nullptr;
  int open_ = 0;                  // helpers that are still wanted
  std::atomic<int> helping_ = 0;  // that are at work
  bool stop_ = false;
};

// Guards the pool and its size. One loop runs at a time: a second caller runs its loop alone.
std::mutex pool_mutex;
std::atomic<int> wanted = 0;  // threads; 0: one per core
Pool* pool = nullptr;  // of the first loop; left at the end of a process, where joining can hang

// Cores that this process may use; those of the machine if that is unknown.
int usable_cores() {
#if defined(__linux__)
  cpu_set_t allowed;
  if (sched_getaffinity(0, sizeof allowed, &allowed) == 0) return std::max(1, CPU_COUNT(&allowed));
#endif
  return std::max(1, int(std::thread::hardware_concurrency()));
}

int size() {
  static const int cores = usable_cores();
  const int count = wanted;
  return count > 0 ? count : cores;
}

#if defined(__unix__) || defined(__APPLE__)
// A forked process has none of the threads, nor the one that held the mutex: its first loop starts
// its own pool.
void forget_pool() { new (&pool_mutex) std::mutex, pool = nullptr; }
[[maybe_unused]] const int at_fork = pthread_atfork(nullptr, nullptr, forget_pool);
#endif

}  // namespace

void set_threads(int count) {
  check(count >= 0, "the number of threads must be 0 (all cores) or more, got ", count);
  const std::lock_guard lock(pool_mutex);
  wanted = count;
  if (!pool || pool->size() == size()) return;
  delete pool;
  pool = nullptr;
}

int threads() { return size(); }

void parallel_for(int count, int grain, const std::function<void(int, int)>& body) {
  if (count <= 0) return;
  Job job(body, count, std::max(1, grain));
  const bool nested = inside_loop || alone;
  std::unique_lock lock(pool_mutex, std::defer_lock);
  if (!nested && count > job.grain && lock.try_lock() && size() > 1) {
    if (!pool) pool = new Pool(size() - 1);
    pool->run(job);
  } else {
    const bool within = inside_loop;
    job.work();
    inside_loop = within;
  }
  if (job.failure) std::rethrow_exception(job.failure);
}

OneThread::OneThread(Loops loops) : before_(alone) { alone = loops == Loops::alone; }
OneThread::~OneThread() { alone = before_; }

}  // namespace fastibl
