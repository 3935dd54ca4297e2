// Python's lock (GIL), for work that goes on without it.
#pragma once

#include <pybind11/pybind11.h>

#ifdef __GLIBCXX__
#include <cxxabi.h>
#endif

#include <chrono>
#include <optional>
#include <thread>
#include <utility>

namespace fastibl::bindings {

// At the interpreter's end, a thread that asks for the GIL is ended on the spot. In C++ that is an
// exception, which goes through destructors, where it would abort the process. The thread waits
// here instead until the process is gone, as all threads do from Python 3.14 on.
template <typename F>
void ask_for_gil(F&& ask) {
#ifdef __GLIBCXX__
  try {
    ask();
  } catch (abi::__forced_unwind&) {
    while (true) std::this_thread::sleep_for(std::chrono::hours(1));
  }
#else
  ask();
#endif
}

// By thread: its state while it has given the GIL away, else null.
inline thread_local PyThreadState* given_away = nullptr;

// Gives the GIL away while it lives.
class WithoutGil {
 public:
  WithoutGil() : before_(given_away) { given_away = PyEval_SaveThread(); }
  ~WithoutGil() {
    ask_for_gil([] { PyEval_RestoreThread(given_away); });
    given_away = before_;
  }
  WithoutGil(const WithoutGil&) = delete;
  WithoutGil& operator=(const WithoutGil&) = delete;

 private:
  PyThreadState* before_;
};

// Has the GIL while it lives, whether its thread had it before or not.
class WithGil {
 public:
  WithGil() : given_(std::exchange(given_away, nullptr)) {
    // Of the interpreter, only this may still be called when it is gone.
    ask_for_gil([&] {
      if (given_)
        PyEval_RestoreThread(given_);
      else
        other_.emplace();
    });
  }
  ~WithGil() {
    if (given_) given_away = PyEval_SaveThread();
  }
  WithGil(const WithGil&) = delete;
  WithGil& operator=(const WithGil&) = delete;

 private:
  PyThreadState* given_;
  std::optional<pybind11::gil_scoped_acquire> other_;
};

}  // namespace fastibl::bindings
