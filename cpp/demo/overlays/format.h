// Numbers as text, the same in every locale.
#pragma once

#include <algorithm>
#include <iomanip>
#include <locale>
#include <sstream>
#include <string>

namespace fastibl::demo {

inline std::string fixed(double value, int digits) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << std::fixed << std::setprecision(digits) << value;
  return text.str();
}
inline std::string padded(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}
inline std::string cut(const std::string& text, int columns) {
  if (int(text.size()) <= columns) return text;
  return text.substr(0, std::size_t(std::max(0, columns - 2))) + "..";
}

}  // namespace fastibl::demo
