#include "fastibl/scene/obj_file.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <numeric>
#include <string>
#include <unordered_map>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr std::size_t kMostCorners = 1024;  // of a polygon

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

// Lines without comments, those that end in a backslash joined to the next.
class Lines {
 public:
  explicit Lines(std::string_view text) : rest_(text) {
    if (rest_.starts_with("\xef\xbb\xbf")) rest_.remove_prefix(3);
  }
  bool next() {
    if (rest_.empty()) return false;
    line_ = cut();
    if (!line_.ends_with('\\')) return true;
    joined_.clear();
    for (std::string_view part = line_; true; part = cut()) {
      const bool more = part.ends_with('\\') && !rest_.empty();
      joined_.append(part.substr(0, part.size() - (more ? 1 : 0))).push_back(' ');
      if (!more) break;
    }
    line_ = joined_;
    return true;
  }
  // The next word of the line; empty at its end.
  std::string_view word() {
    while (!line_.empty() && is_space(line_.front())) line_.remove_prefix(1);
    std::size_t n = 0;
    while (n < line_.size() && !is_space(line_[n])) ++n;
    const std::string_view found = line_.substr(0, n);
    line_.remove_prefix(n);
    return found;
  }
  int number() const { return number_; }

 private:
  std::string_view cut() {
    ++number_;
    const std::size_t end = std::min(rest_.find('\n'), rest_.size());
    std::string_view line = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    line = line.substr(0, line.find('#'));
    while (!line.empty() && is_space(line.back())) line.remove_suffix(1);
    return line;
  }
  std::string_view rest_, line_;
  std::string joined_;
  int number_ = 0;
};

glm::dvec3 three_numbers(Lines& lines) {
  glm::dvec3 p;
  for (int k = 0; k < 3; ++k) {
    std::string_view word = lines.word();
    if (word.starts_with('+')) word.remove_prefix(1);
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), p[k]);
    check((error == std::errc() || error == std::errc::result_out_of_range) &&
              end == word.data() + word.size(),
          "line ", lines.number(), ": expected three numbers, got \"", word, "\"");
    if (error != std::errc()) p[k] = std::numeric_limits<double>::infinity();
  }
  return p;
}

struct Corner {
  long place, normal;  // from 0; -1: none
};

// "7", "7/1", "7//3" or "7/1/3"; what is negative counts back from the last one so far.
Corner corner_of(std::string_view word, std::size_t places, std::size_t normals, int line) {
  Corner corner{-1, -1};
  std::string_view rest = word;
  for (int part = 0; part < 3; ++part) {
    const std::string_view text = rest.substr(0, rest.find('/'));
    rest.remove_prefix(std::min(text.size() + 1, rest.size()));
    if (text.empty() && part > 0) continue;
    long index = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), index);
    if (part == 1) continue;
    const std::size_t count = part == 0 ? places : normals;
    if (index < 0) index += long(count) + 1;
    check(error == std::errc() && end == text.data() + text.size() && index >= 1, "line ", line,
          ": expected a ", part == 0 ? "vertex" : "normal", " from 1 on, or back from -1, got \"",
          word, "\"");
    (part == 0 ? corner.place : corner.normal) = index - 1;
  }
  return corner;
}

// Twice the signed area of a triangle in the plane.
double area(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// Vertices of a mesh, each place and normal once.
class Vertices {
 public:
  int add(glm::vec3 place, glm::vec3 normal, long index) {
    const glm::vec3 both[] = {place + 0.0f, normal + 0.0f};  // -0 is 0
    const auto [entry, fresh] = numbers_.try_emplace(
        std::string(reinterpret_cast<const char*>(both), sizeof(both)), int(all_.size()));
    if (fresh) all_.push_back({place, normal, index});
    return entry->second;
  }
  // In the file's order.
  void give_to(Mesh& mesh, bool with_normals) const {
    std::vector<int> order(all_.size()), number(all_.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
      return all_[std::size_t(a)].index < all_[std::size_t(b)].index;
    });
    for (const int i : order) {
      number[std::size_t(i)] = int(mesh.vertices.size());
      mesh.vertices.push_back(all_[std::size_t(i)].place);
      if (with_normals) mesh.normals.push_back(all_[std::size_t(i)].normal);
    }
    for (glm::ivec3& t : mesh.triangles)
      for (int k = 0; k < 3; ++k) t[k] = number[std::size_t(t[k])];
  }

 private:
  struct Vertex {
    glm::vec3 place, normal;
    long index;  // in the file
  };
  std::vector<Vertex> all_;
  std::unordered_map<std::string, int> numbers_;
};

}  // namespace

std::vector<glm::ivec3> polygon_triangles(const std::vector<glm::dvec3>& polygon) {
  const std::size_t n = polygon.size();
  check(n >= 3, "a polygon has at least 3 corners, got ", n);
  glm::dvec3 normal(0);  // Newell's
  for (std::size_t i = 0; i < n; ++i)
    normal += glm::cross(polygon[i] - polygon[0], polygon[(i + 1) % n] - polygon[0]);
  const glm::dvec3 size = glm::abs(normal);
  const int drop = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  const int u = (drop + 1) % 3, v = (drop + 2) % 3;
  const double side = normal[drop] < 0 ? -1 : 1;
  std::vector<glm::dvec2> flat;
  for (const glm::dvec3& p : polygon) flat.emplace_back(p[u], side * p[v]);
  std::vector<int> left(n);
  for (std::size_t i = 0; i < n; ++i) left[i] = int(i);
  std::vector<glm::ivec3> result;
  const auto at = [&](std::size_t i) { return flat[std::size_t(left[i % left.size()])]; };
  const auto is_ear = [&](std::size_t i) {  // whose tip is left[i]
    const std::size_t count = left.size();
    const glm::dvec2 a = at(i + count - 1), b = at(i), c = at(i + 1);
    if (!(area(a, b, c) > 0)) return false;
    for (std::size_t k = i + 2; k < i + count - 1; ++k) {
      const glm::dvec2 p = at(k);
      if (p != a && p != b && p != c && area(a, b, p) >= 0 && area(b, c, p) >= 0 &&
          area(c, a, p) >= 0)
        return false;
    }
    return true;
  };
  while (left.size() > 3) {
    std::size_t tip = 1;  // of what is flat, any
    for (std::size_t i = 1; i <= left.size(); ++i)
      if (is_ear(i % left.size())) {
        tip = i % left.size();
        break;
      }
    const std::size_t count = left.size();
    result.emplace_back(left[(tip + count - 1) % count], left[tip], left[(tip + 1) % count]);
    left.erase(left.begin() + long(tip));
  }
  result.emplace_back(left[0], left[1], left[2]);
  return result;
}

Mesh read_obj(std::string_view text) {
  std::vector<glm::dvec3> places, normals;
  struct Face {
    int line;
    std::size_t first, count;  // of its corners
  };
  std::vector<Corner> corners;
  std::vector<Face> faces;
  bool all_normals = true;
  Lines lines(text);
  while (lines.next()) {
    const std::string_view kind = lines.word();
    if (kind == "v") places.push_back(three_numbers(lines));
    if (kind == "vn") normals.push_back(three_numbers(lines));
    if (kind != "f") continue;
    const std::size_t first = corners.size();
    for (std::string_view word = lines.word(); !word.empty(); word = lines.word()) {
      corners.push_back(corner_of(word, places.size(), normals.size(), lines.number()));
      all_normals = all_normals && corners.back().normal >= 0;
    }
    const std::size_t count = corners.size() - first;
    check(count >= 3, "line ", lines.number(), ": a face needs at least 3 corners, got ", count);
    check(count <= kMostCorners, "line ", lines.number(), ": a face may have ", kMostCorners,
          " corners, got ", count);
    faces.push_back({lines.number(), first, count});
  }
  check(!faces.empty(), "it holds no triangles");
  Mesh mesh;
  Vertices vertices;
  const auto within = [](long index, std::size_t count, const char* what, int line) {
    check(std::size_t(index) < count, "line ", line, ": expected a ", what, " from 1 to ", count,
          ", got \"", index + 1, "\"");
    return std::size_t(index);
  };
  std::vector<glm::dvec3> polygon;
  std::vector<int> used;
  for (const Face& face : faces) {
    polygon.clear(), used.clear();
    for (std::size_t i = face.first; i < face.first + face.count; ++i) {
      const glm::dvec3& p = places[within(corners[i].place, places.size(), "vertex", face.line)];
      glm::vec3 normal(0);
      if (all_normals) {
        const glm::dvec3& n =
            normals[within(corners[i].normal, normals.size(), "normal", face.line)];
        const double length = glm::length(n);
        if (length > 0) normal = glm::vec3(n / length);
      }
      polygon.push_back(p);
      used.push_back(vertices.add(glm::vec3(p), normal, corners[i].place));
    }
    if (face.count == 3)
      mesh.triangles.emplace_back(used[0], used[1], used[2]);
    else
      for (const glm::ivec3& t : polygon_triangles(polygon))
        mesh.triangles.emplace_back(used[std::size_t(t.x)], used[std::size_t(t.y)],
                                    used[std::size_t(t.z)]);
  }
  vertices.give_to(mesh, all_normals);
  mesh.validate();
  return mesh;
}

}  // namespace fastibl
