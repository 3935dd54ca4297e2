// Checks of what callers pass in: they throw std::invalid_argument (ValueError in Python) and say
// what was expected and what was given. Library code never exits or aborts.
// Not for headers that programs include: some have a macro of that name, or no exceptions.
#pragma once

#include <sstream>
#include <stdexcept>

namespace fastibl {

template <typename... Parts>
[[noreturn]] void invalid(const Parts&... message) {
  std::ostringstream text;
  (text << ... << message);
  throw std::invalid_argument(text.str());
}

// check(size > 0, "face size must be at least 1, got ", size);
template <typename... Parts>
void check(bool holds, const Parts&... message) {
  if (!holds) invalid(message...);
}

}  // namespace fastibl
