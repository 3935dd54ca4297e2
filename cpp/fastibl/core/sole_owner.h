// Whether what a shared_ptr holds may be written, since nobody else holds it.
#pragma once

#include <atomic>
#include <memory>

#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define FASTIBL_THREAD_SANITIZER
#endif
#endif
#ifdef __SANITIZE_THREAD__
#define FASTIBL_THREAD_SANITIZER
#endif

namespace fastibl {

// If true, what others did with it before they let it go is done.
template <typename T>
bool is_sole_owner(const std::shared_ptr<T>& pointer) {
  if (pointer.use_count() != 1) return false;
#ifdef FASTIBL_THREAD_SANITIZER
  // The sanitizer knows no fences; one more pointer that is let go acquires what others released.
  const std::shared_ptr<T> one_more = pointer;
#else
  std::atomic_thread_fence(std::memory_order_acquire);
#endif
  return true;
}

}  // namespace fastibl
