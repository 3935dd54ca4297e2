// For objects that calls change, and that several of Python's threads may call.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <new>
#include <utility>

#include "bindings/gil.h"

namespace fastibl::bindings {

// Those of all objects, by address; some objects share one, and then wait for each other.
inline std::array<std::recursive_mutex, 64> object_mutexes;

inline std::recursive_mutex& mutex_of(const void* address) {
  return object_mutexes[(reinterpret_cast<std::uintptr_t>(address) >> 6) * 0x9E3779B97F4A7C15u >>
                        58];
}

// For a forked process: the threads that hold mutexes are not in it, and would hold them for ever.
inline void free_mutexes() { new (&object_mutexes) std::array<std::recursive_mutex, 64>; }

// Runs f while no other call runs on the object, nor on a part of it that Python sees as an object
// of its own. The interpreter goes on meanwhile. f must not touch Python's objects, but may call
// code that does so with the GIL, and that may call the object again.
template <typename F>
auto one_at_a_time(const void* object, const void* part, F&& f) {
  const WithoutGil release;
  const std::scoped_lock lock(mutex_of(object), mutex_of(part));
  return std::forward<F>(f)();
}
template <typename F>
auto one_at_a_time(const void* object, F&& f) {
  return one_at_a_time(object, object, std::forward<F>(f));
}

}  // namespace fastibl::bindings
