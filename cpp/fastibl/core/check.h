// Checks of what callers pass in: they throw std::invalid_argument (ValueError in Python) and say
// what was expected and what was given. Library code never exits or aborts.
#pragma once

#include <sstream>
#include <stdexcept>

namespace fastibl {

// check(size > 0, "face size must be at least 1, got ", size);
template <typename... Parts>
void check(bool holds, const Parts&... message) {
  if (holds) return;
  std::ostringstream text;
  (text << ... << message);
  throw std::invalid_argument(text.str());
}

}  // namespace fastibl
