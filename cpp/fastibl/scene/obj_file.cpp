#include "fastibl/scene/obj_file.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <system_error>
#include <unordered_map>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parse_number.h"
#include "fastibl/scene/response.h"
#include "fastibl/scene/rounded_places.h"

namespace fastibl {
namespace {

constexpr std::size_t kMostCorners = 1024;  // of a polygon
constexpr glm::dvec3 kUnpainted(-1);        // of a vertex without a colour
constexpr double kMostOfOne = 1.5;          // colours whose white is 1 hardly exceed it

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

// Whether a line holds a name, in which # may stand, as in "Material #25".
bool is_name(std::string_view line) {
  while (!line.empty() && is_space(line.front())) line.remove_prefix(1);
  return line.starts_with("usemtl") || line.starts_with("mtllib");
}

// Lines without comments; a line that ends in a backslash is joined to the next.
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
  // What follows the words so far: on lines with a name, comments too.
  std::string_view rest() {
    while (!line_.empty() && is_space(line_.front())) line_.remove_prefix(1);
    return line_;
  }
  int number() const { return number_; }

 private:
  std::string_view cut() {
    ++number_;
    const std::size_t end = std::min(rest_.find('\n'), rest_.size());
    std::string_view line = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    if (!is_name(line)) line = line.substr(0, line.find('#'));
    while (!line.empty() && is_space(line.back())) line.remove_suffix(1);
    return line;
  }
  std::string_view rest_, line_;
  std::string joined_;
  int number_ = 0;
};

double number_of(std::string_view word, const char* expected, int line) {
  if (word.starts_with('+')) word.remove_prefix(1);
  const std::optional<double> value = parse_number(word);
  check(value.has_value(), "line ", line, ": expected ", expected, ", got \"", word, "\"");
  return *value;
}

glm::dvec3 three_numbers(Lines& lines) {
  glm::dvec3 p;
  for (int k = 0; k < 3; ++k) p[k] = number_of(lines.word(), "three numbers", lines.number());
  return p;
}

// After a place, MeshLab writes a colour (three numbers); others write a weight, or both.
void add_color(Lines& lines, std::size_t vertex, std::vector<glm::dvec3>& colors) {
  std::array<std::string_view, 4> words;
  std::size_t count = 0;
  for (std::string_view word = lines.word(); !word.empty() && count < 4; word = lines.word())
    words[count++] = word;
  if (count < 3) return;
  colors.resize(vertex, glm::dvec3(kUnpainted));
  glm::dvec3& color = colors.emplace_back();
  for (std::size_t k = 0; k < 3; ++k)
    color[int(k)] = number_of(words[count - 3 + k], "three numbers of a colour", lines.number());
}

// The colours are sRGB, with white 1 or 255.
void make_linear(std::vector<glm::dvec3>& colors) {
  double most = 0;
  for (const glm::dvec3& color : colors)
    if (color != kUnpainted) most = std::max({most, color.x, color.y, color.z});
  for (glm::dvec3& color : colors) {
    if (color == kUnpainted)
      color = glm::dvec3(1);
    else
      for (int k = 0; k < 3; ++k)
        color[k] = Response::srgb().decode(float(color[k] / (most > kMostOfOne ? 255 : 1)));
  }
}

// A single number is a u.
glm::vec2 uv_of(Lines& lines) {
  const double u = number_of(lines.word(), "one to three numbers", lines.number());
  const std::string_view v = lines.word();
  return glm::vec2(u, v.empty() ? 0.0 : number_of(v, "one to three numbers", lines.number()));
}

constexpr const char* kParts[] = {"vertex", "uv", "normal"};  // of a corner, as written
using Corner = std::array<long, 3>;                           // from 0; -1: none

// "7", "7/1", "7//3" or "7/1/3". A negative number counts back from the last one so far, of which
// there are `counts`. Unwanted uvs are not looked at.
Corner corner_of(std::string_view word, const std::array<std::size_t, 3>& counts, bool with_uvs,
                 int line) {
  Corner corner{-1, -1, -1};
  std::string_view rest = word;
  for (std::size_t part = 0; part < 3; ++part) {
    const std::string_view text = rest.substr(0, rest.find('/'));
    rest.remove_prefix(std::min(text.size() + 1, rest.size()));
    if ((text.empty() && part > 0) || (part == 1 && !with_uvs)) continue;
    long index = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), index);
    if (index < 0) index += long(counts[part]) + 1;
    check(error == std::errc() && end == text.data() + text.size() && index >= 1, "line ", line,
          ": expected a ", kParts[part], " from 1 on, or back from -1, got \"", word, "\"");
    corner[part] = index - 1;
  }
  return corner;
}

// Twice the signed area of a triangle in the plane.
double area(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

struct Vertex {
  glm::vec3 place, normal = glm::vec3(0);
  glm::vec2 uv = glm::vec2(0);
  glm::vec3 color = glm::vec3(1);
};

// Which of a vertex's values a mesh keeps.
struct Kept {
  bool normals, uvs, colors;
};

// Vertices of a mesh: each set of place, normal, uv and colour once.
class Vertices {
 public:
  // index: in the file
  int add(const Vertex& v, long index) {
    const float every[] = {v.place.x, v.place.y, v.place.z, v.normal.x, v.normal.y, v.normal.z,
                           v.uv.x,    v.uv.y,    v.color.x, v.color.y,  v.color.z};
    float key[std::size(every)];
    for (std::size_t k = 0; k < std::size(every); ++k) key[k] = every[k] + 0.0f;  // -0 is 0
    const auto [entry, fresh] = numbers_.try_emplace(
        std::string(reinterpret_cast<const char*>(key), sizeof(key)), int(all_.size()));
    if (fresh) all_.push_back({v, index});
    return entry->second;
  }
  // In the file's order.
  void give_to(Mesh& mesh, const Kept& kept) const {
    std::vector<int> order(all_.size()), number(all_.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
      return all_[std::size_t(a)].index < all_[std::size_t(b)].index;
    });
    for (const int i : order) {
      number[std::size_t(i)] = int(mesh.vertices.size());
      const Vertex& v = all_[std::size_t(i)].vertex;
      mesh.vertices.push_back(v.place);
      if (kept.normals) mesh.normals.push_back(v.normal);
      if (kept.uvs) mesh.uvs.push_back(v.uv);
      if (kept.colors) mesh.colors.push_back(v.color);
    }
    for (glm::ivec3& t : mesh.triangles)
      for (int k = 0; k < 3; ++k) t[k] = number[std::size_t(t[k])];
  }

 private:
  struct Numbered {
    Vertex vertex;
    long index;
  };
  std::vector<Numbered> all_;
  std::unordered_map<std::string, int> numbers_;
};

// corners: of the file's faces, one for each of `vertices`. triangles: indices of these.
Mesh merged(const std::vector<Vertex>& vertices, const std::vector<Corner>& corners,
            std::vector<glm::ivec3> triangles, const Kept& kept) {
  Vertices once;
  std::vector<int> number;
  for (std::size_t i = 0; i < vertices.size(); ++i)
    number.push_back(once.add(vertices[i], corners[i][0]));
  for (glm::ivec3& t : triangles)
    for (int k = 0; k < 3; ++k) t[k] = number[std::size_t(t[k])];
  Mesh mesh;
  mesh.triangles = std::move(triangles);
  once.give_to(mesh, kept);
  return mesh;
}

// Subtracts what keeps the places that faces name from being rounded away, and returns it. Names
// that are out of range are told later.
glm::dvec3 subtract_offset(std::vector<glm::dvec3>& places, const std::vector<Corner>& corners) {
  glm::dvec3 lower(std::numeric_limits<double>::infinity()), upper = -lower;
  for (const Corner& corner : corners) {
    if (corner[0] >= long(places.size())) continue;
    lower = glm::min(lower, places[std::size_t(corner[0])]);
    upper = glm::max(upper, places[std::size_t(corner[0])]);
  }
  const glm::dvec3 offset = offset_before_rounding(lower, upper);
  if (offset != glm::dvec3(0))
    for (glm::dvec3& place : places) place -= offset;
  return offset;
}

// Normals of the corners, as a scene works them out for a mesh of these places alone.
std::vector<glm::vec3> smooth_normals(std::vector<Vertex> vertices,
                                      const std::vector<Corner>& corners,
                                      const std::vector<glm::ivec3>& triangles) {
  for (Vertex& v : vertices) v = {v.place};
  const Mesh mesh = with_creases(merged(vertices, corners, triangles, {}));
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  std::vector<glm::vec3> found(vertices.size());
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (int k = 0; k < 3; ++k)
      found[std::size_t(triangles[i][k])] = normals[std::size_t(mesh.triangles[i][k])];
  return found;
}

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
    std::size_t tip = 1;  // where all is flat, any
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

Mesh read_obj(std::string_view text, const ObjOptions& options, ObjMaterials* materials,
              glm::dvec3* offset) {
  if (materials) *materials = {};
  std::unordered_map<std::string, int> material_numbers;
  int material = -1;
  std::vector<glm::dvec3> places, normals;
  std::vector<glm::dvec3> colors;  // of the places; shorter, or empty, where the last have none
  std::vector<glm::vec2> uvs;
  struct Face {
    int line, material;
    std::size_t first, count;  // of its corners
  };
  std::vector<Corner> corners;
  std::vector<Face> faces;
  Lines lines(text);
  while (lines.next()) {
    const std::string_view kind = lines.word();
    if (kind == "v") {
      places.push_back(three_numbers(lines));
      if (options.colors) add_color(lines, places.size() - 1, colors);
    }
    if (kind == "vn") normals.push_back(three_numbers(lines));
    if (kind == "vt" && options.uvs) uvs.push_back(uv_of(lines));
    if (materials && kind == "mtllib") materials->libraries.emplace_back(lines.rest());
    if (materials && kind == "usemtl") {
      const std::string name(lines.rest());
      const auto [at, fresh] = material_numbers.try_emplace(name, int(materials->names.size()));
      if (fresh) materials->names.push_back(name);
      material = at->second;
    }
    if (kind != "f") continue;
    const std::size_t first = corners.size();
    const std::array<std::size_t, 3> counts{places.size(), uvs.size(), normals.size()};
    for (std::string_view word = lines.word(); !word.empty(); word = lines.word())
      corners.push_back(corner_of(word, counts, options.uvs, lines.number()));
    const std::size_t count = corners.size() - first;
    check(count >= 3, "line ", lines.number(), ": a face needs at least 3 corners, got ", count);
    check(count <= kMostCorners, "line ", lines.number(), ": a face may have ", kMostCorners,
          " corners, got ", count);
    faces.push_back({lines.number(), material, first, count});
  }
  check(!faces.empty(), "it holds no triangles");
  const auto has = [](std::size_t part) {
    return [part](const Corner& corner) { return corner[part] >= 0; };
  };
  // If only some faces name normals and none is given, they are ignored.
  if (normals.empty() && !std::all_of(corners.begin(), corners.end(), has(2)))
    for (Corner& corner : corners) corner[2] = -1;
  const bool with_uvs = options.uvs && std::any_of(corners.begin(), corners.end(), has(1));
  const bool with_normals =
      with_uvs || materials || std::any_of(corners.begin(), corners.end(), has(2));
  make_linear(colors);
  const glm::dvec3 subtracted = subtract_offset(places, corners);
  if (offset) *offset = subtracted;

  std::vector<Vertex> vertices;  // of the corners
  std::vector<glm::ivec3> triangles;
  const std::array<std::size_t, 3> counts{places.size(), uvs.size(), normals.size()};
  std::vector<glm::dvec3> polygon;
  for (const Face& face : faces) {
    polygon.clear();
    for (std::size_t i = face.first; i < face.first + face.count; ++i) {
      for (std::size_t part = 0; part < 3; ++part)
        check(corners[i][part] < long(counts[part]), "line ", face.line, ": expected a ",
              kParts[part], " from 1 to ", counts[part], ", got \"", corners[i][part] + 1, "\"");
      const auto at = [&](std::size_t part) { return std::size_t(corners[i][part]); };
      polygon.push_back(places[at(0)]);
      Vertex vertex{glm::vec3(polygon.back())};
      if (corners[i][1] >= 0) vertex.uv = uvs[at(1)];
      if (at(0) < colors.size()) vertex.color = glm::vec3(colors[at(0)]);
      if (corners[i][2] >= 0)
        if (const double length = glm::length(normals[at(2)]); length > 0)
          vertex.normal = glm::vec3(normals[at(2)] / length);
      vertices.push_back(vertex);
    }
    const int first = int(face.first);
    if (face.count == 3)
      triangles.emplace_back(first, first + 1, first + 2);
    else
      for (const glm::ivec3& t : polygon_triangles(polygon)) triangles.push_back(first + t);
    if (materials) materials->of_triangles.resize(triangles.size(), face.material);
  }
  if (with_normals && !std::all_of(corners.begin(), corners.end(), has(2))) {
    const std::vector<glm::vec3> smooth = smooth_normals(vertices, corners, triangles);
    for (std::size_t i = 0; i < corners.size(); ++i)
      if (corners[i][2] < 0) vertices[i].normal = smooth[i];
  }
  Mesh mesh = merged(vertices, corners, triangles, {with_normals, with_uvs, !colors.empty()});
  mesh.validate();
  return mesh;
}

}  // namespace fastibl
