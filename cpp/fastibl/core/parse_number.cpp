#include "fastibl/core/parse_number.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <limits>
#include <locale>
#include <sstream>
#include <string>
#include <system_error>

namespace fastibl {
namespace {

// Streams take more, by library: hexadecimal numbers, spaces, a sign.
bool is_decimal(std::string_view text) {
  const auto skip = [&](std::string_view some, std::size_t most) {
    const std::size_t count = std::min({text.find_first_not_of(some), text.size(), most});
    text.remove_prefix(count);
    return count;
  };
  const auto digits = [&] { return skip("0123456789", text.size()); };
  skip("-", 1);
  std::size_t count = digits();
  if (skip(".", 1)) count += digits();
  if (count == 0) return false;
  if (skip("eE", 1)) {
    skip("+-", 1);
    if (digits() == 0) return false;
  }
  return text.empty();
}

// "inf", "infinity" and "nan", in letters of any size; otherwise none.
std::optional<double> named(std::string_view text) {
  const bool negative = text.starts_with('-');
  if (negative) text.remove_prefix(1);
  const auto is = [&](std::string_view name) {  // | 0x20 makes a letter small
    return std::ranges::equal(text, name, [](char a, char b) { return (a | 0x20) == b; });
  };
  using Limits = std::numeric_limits<double>;
  if (is("nan")) return Limits::quiet_NaN();
  if (is("inf") || is("infinity")) return negative ? -Limits::infinity() : Limits::infinity();
  return std::nullopt;
}

}  // namespace

std::optional<double> parse_number_by_stream(std::string_view text) {
  if (!is_decimal(text)) return named(text);
  std::istringstream stream{std::string(text)};
  stream.imbue(std::locale::classic());
  double value = 0;
  stream >> value;  // out of range, it fails with the largest number or with what is left
  if (!stream.fail() || std::fabs(value) < 1) return value;
  return std::copysign(std::numeric_limits<double>::infinity(), value);
}

std::optional<double> parse_number(std::string_view text) {
#ifdef __cpp_lib_to_chars
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (end != text.data() + text.size()) return std::nullopt;
  if (error == std::errc()) return value;
#endif
  return parse_number_by_stream(text);
}

}  // namespace fastibl
