#include "demo/calibration_text.h"

#include <fstream>
#include <iterator>
#include <string_view>

#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostBytes = 1 << 22;
constexpr int kDeepest = 32;  // nesting levels; a calibration has five

bool is_blank(char c) { return c == ' ' || c == '\t'; }

// Whether YAML, JSON or XML nests deeper than that: judged by indents, by levels within a line, or
// by brackets and tags.
bool nests(std::string_view text) {
  int depth = 0, in_line = 0, indent = 0;
  bool begun = false;  // whether the line has begun, after its indent
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i], next = i + 1 < text.size() ? text[i + 1] : '\n';
    if (c == '\n' || c == '\r') {
      in_line = indent = 0, begun = false;
      continue;
    }
    begun |= !is_blank(c);
    if (!begun) {
      if (++indent >= 8 * kDeepest) return true;
    } else if (c == '[' || c == '{') {
      ++depth, in_line = 0;
    } else if (c == ']' || c == '}') {
      --depth, in_line = 0;
    } else if (c == ',') {
      in_line = 0;
    } else if (c == ':' || (c == '-' && is_blank(next))) {
      ++in_line;
    } else if (c == '<' && next != '?' && next != '!') {
      depth += next == '/' ? -1 : 1;
    } else if (c == '/' && next == '>') {
      --depth;
    }
    if (depth > kDeepest || in_line > kDeepest) return true;
  }
  return false;
}

bool is_binary(const std::string& text) {
  for (const char* mark : {"!!binary", "$base64$", "\"binary", "'binary"})
    if (text.find(mark) != text.npos) return true;
  return false;
}

}  // namespace

std::string calibration_text(const fs::path& path) {
  check(fs::is_regular_file(path), "the file ", path.string(), " is missing");
  check(fs::file_size(path) <= kMostBytes, path.string(), " has ", fs::file_size(path),
        " bytes; a calibration has at most ", kMostBytes);
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  check(!nests(text), path.string(), " nests more than ", kDeepest,
        " levels deep; a calibration has five");
  check(!is_binary(text), path.string(),
        " holds binary data; expected numbers as text, as OpenCV's FileStorage writes them");
  return text;
}

}  // namespace fastibl::demo
