// Numbers in texts, whatever the program's locale.
#pragma once

#include <optional>
#include <string_view>

namespace fastibl {

// A decimal number that takes up the whole text, such as "-12.5e3", "inf" or "NaN"; "+1" and " 1"
// are none. Beyond a double's range: infinity, or about 0.
std::optional<double> parse_number(std::string_view text);

// The same by a stream, ten times as slow: for standard libraries whose std::from_chars knows no
// doubles (libc++ before version 20: macOS, Android), and for numbers out of range.
std::optional<double> parse_number_by_stream(std::string_view text);

}  // namespace fastibl
