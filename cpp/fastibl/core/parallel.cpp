#include "fastibl/core/parallel.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

thread_local bool inside_loop = false;

struct Job {
  Job(const std::function<void(int, int)>& f, int n, int g) : body(&f), count(n), grain(g) {}

  const std::function<void(int, int)>* body;
  int count, grain;
  std::atomic<int> next{0};
  std::mutex failure_mutex;
  std::exception_ptr failure;

  void work() {
    inside_loop = true;
    for (int begin; (begin = next.fetch_add(grain)) < count;) {
      try {
        (*body)(begin, std::min(begin + grain, count));
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (!failure) failure = std::current_exception();
      }
    }
    inside_loop = false;
  }
};

class Pool {
 public:
  explicit Pool(int helpers) {
    for (int i = 0; i < helpers; ++i) workers_.emplace_back([this] { serve(); });
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

  void run(Job& job) {
    {
      const std::lock_guard lock(mutex_);
      job_ = &job;
      busy_ = int(workers_.size());
      ++round_;
    }
    wake_.notify_all();
    job.work();
    std::unique_lock lock(mutex_);
    idle_.wait(lock, [this] { return busy_ == 0; });
    job_ = nullptr;
  }

 private:
  void serve() {
    long seen = 0;
    while (true) {
      Job* job = nullptr;
      {
        std::unique_lock lock(mutex_);
        wake_.wait(lock, [&] { return stop_ || round_ != seen; });
        if (stop_) return;
        seen = round_;
        job = job_;
      }
      job->work();
      const std::lock_guard lock(mutex_);
      if (--busy_ == 0) idle_.notify_one();
    }
  }

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable wake_, idle_;
  Job* job_ = nullptr;
  int busy_ = 0;
  long round_ = 0;
  bool stop_ = false;
};

std::mutex pool_mutex;  // one loop at a time: a second caller runs its loop alone

Pool*& pool() {
  // Never destroyed: joining threads while a Python process ends can hang.
  static Pool* instance = new Pool(0);
  return instance;
}

}  // namespace

void set_threads(int count) {
  check(count >= 0, "the number of threads must be 0 (all cores) or more, got ", count);
  if (count == 0) count = std::max(1u, std::thread::hardware_concurrency());
  const std::lock_guard lock(pool_mutex);
  if (pool()->size() == count) return;
  delete pool();
  pool() = new Pool(count - 1);
}

int threads() {
  const std::lock_guard lock(pool_mutex);
  return pool()->size();
}

void parallel_for(int count, int grain, const std::function<void(int, int)>& body) {
  if (count <= 0) return;
  Job job(body, count, std::max(1, grain));
  const bool nested = inside_loop;
  std::unique_lock lock(pool_mutex, std::defer_lock);
  if (!nested && count > job.grain && lock.try_lock() && pool()->size() > 1) {
    pool()->run(job);
  } else {
    job.work();
    inside_loop = nested;
  }
  if (job.failure) std::rethrow_exception(job.failure);
}

}  // namespace fastibl
