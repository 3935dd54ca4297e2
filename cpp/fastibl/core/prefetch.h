// Prefetches memory before it is worked on: no processor foresees accesses to many short runs.
#pragma once

#include <cstddef>

namespace fastibl {

inline void prefetch(const void* from, std::size_t bytes) {
#if defined(__GNUC__)
  constexpr std::size_t kLine = 64;
  const char* at = static_cast<const char*>(from);
  for (std::size_t i = 0; i < bytes; i += kLine) __builtin_prefetch(at + i);
#else
  (void)from, (void)bytes;
#endif
}

// The same for several items of the same kind.
template <typename T>
void prefetch_items(const T* from, std::size_t count) {
  prefetch(from, count * sizeof(T));
}

}  // namespace fastibl
