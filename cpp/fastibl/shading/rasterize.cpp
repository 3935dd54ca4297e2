#include "fastibl/shading/rasterize.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kBand = 16;              // rows that one thread fills at a time
constexpr double kFarthest = 1 << 21;  // pixels: beyond, fixed-point edges would overflow
constexpr int kVertices = 1024;        // that one thread takes at a time

// In the picture, y down, a triangle seen from outside runs clockwise: its area is negative.
bool is_back(const PictureCorner& a, const PictureCorner& b, const PictureCorner& c) {
  return edge(a, b, c.x, c.y) > 0;
}

PictureCorner picture_corner(const Lens& lens, const glm::dvec3& p) {
  const auto pixel = lens.project(p);
  if (!pixel || !(std::abs(pixel->x) < kFarthest) || !(std::abs(pixel->y) < kFarthest)) return {};
  return {std::llround(pixel->x * kSubpixel), std::llround(pixel->y * kSubpixel), float(1 / p.z),
          true};
}

bool is_inside(const Bounds& box, glm::dvec3 p) {
  return glm::all(glm::greaterThanEqual(p, glm::dvec3(box.lower))) &&
         glm::all(glm::lessThanEqual(p, glm::dvec3(box.upper)));
}

constexpr float kNoneAlike = 2, kNever = -2;

// Radians, at most 1, the width for what is matte.
float lobe_width(const Material& material) {
  const std::optional<LobeShape> lobe = material.lobe();
  return lobe ? std::min(2 / std::sqrt(lobe->exponent), 1.0f) : 1.0f;
}
// About how much of what a material reflects is glossy.
float glossy_part(const Material& m) {
  const auto mean = [](glm::vec3 colour) { return (colour.x + colour.y + colour.z) / 3; };
  if (m.textured()) return 1;
  const float metallic = m.pbr ? m.pbr->metallic : 0;
  const float base = m.pbr ? mean(m.pbr->base_color) : 0;
  const float glossy =
      m.pbr ? m.pbr->specular * mean(m.pbr->dielectric()) + metallic * base : mean(m.glossy);
  const float diffuse = m.pbr ? (1 - metallic) * base : mean(m.diffuse);
  return glossy > 0 ? glossy / (glossy + diffuse) : 0.0f;
}
float small_cosine(float angle) { return 1 - 0.5f * angle * angle; }

// Cosine of the angle within which a material's value at the mean of two normals is about the mean
// of its two values.
float alike_cosine(const Material& material) {
  constexpr float kPart = 1.0f / 12;
  // Textures may change from triangle to triangle.
  return material.textured() ? kNoneAlike : small_cosine(kPart * lobe_width(material));
}

// Whether the normals at two samples of a pixel may be farther apart than this cosine says. least:
// cosine between the triangle's own normals. They lie `chord` apart. Over a triangle of this
// height, their mean n changes by at most 3 chord ratio / height from pixel to pixel, where `ratio`
// is that of the triangle's depths, and n is at least sqrt(1 - chord^2 / 3) long.
bool may_bend(const PictureCorner& a, const PictureCorner& b, const PictureCorner& c, float least,
              float cosine) {
  constexpr float kApart = 0.8f * kSubpixel;  // two samples of a pixel
  if (least >= cosine) return false;
  if (!(least > 0.4f)) return true;
  const auto squared = [](const PictureCorner& p, const PictureCorner& q) {
    const float x = float(q.x - p.x), y = float(q.y - p.y);
    return x * x + y * y;
  };
  const float longest = std::sqrt(std::max({squared(a, b), squared(b, c), squared(c, a)}));
  const float height = std::abs(float(edge(a, b, c.x, c.y))) / longest;
  const auto [far, near] = std::minmax({a.inverse_depth, b.inverse_depth, c.inverse_depth});
  const float squared_chord = 2 - 2 * least;
  const float step = kApart * 3 * std::sqrt(squared_chord) * (near / far) / height;
  return !(step * step < (2 - 2 * cosine) * (1 - squared_chord / 3));
}

}  // namespace

float curved_cosine(const Material& material) {
  constexpr float kPart = 1.0f / 2;
  constexpr float kFlat = 1 - 1e-5f;  // of a mirror: less is rounding
  const float angle = kPart * lobe_width(material) / std::sqrt(glossy_part(material));
  return angle < kPart ? std::min(small_cosine(angle), kFlat) : kNever;
}

struct Rasterizer::Geometry {
  const Scene& scene;
  const Camera& camera;
  const Mesh& holdout;                     // may be empty
  std::span<const glm::vec4> back_shares;  // may be empty, as the next
  std::span<const glm::vec4> holdout_ratios;
  std::span<const glm::vec3> colors;
  bool fronts_only;     // backs of the object's triangles are hidden
  bool surface;         // tangents are asked for
  bool textured;        // texture coordinates are
  float alike_cosine;   // of normals that are merged
  float curved_cosine;  // of normals that are too far apart for one
  const CutMesh& cut;

  // Vertices and triangles of the holdouts follow the object's. New ones, where they are cut,
  // follow both.
  std::size_t own() const { return scene.mesh.vertices.size(); }
  std::size_t vertices() const { return own() + holdout.vertices.size(); }
  std::size_t own_triangles() const { return scene.mesh.triangles.size(); }
  std::size_t whole_triangles() const { return own_triangles() + holdout.triangles.size(); }
  std::size_t triangles() const { return whole_triangles() + cut.triangles.size(); }
  glm::ivec3 corners_of(std::size_t t) const {
    return t < own_triangles()     ? scene.mesh.triangles[t]
           : t < whole_triangles() ? holdout.triangles[t - own_triangles()] + int(own())
                                   : cut.triangles[t - whole_triangles()].corners;
  }
  // The triangle that this one is, or is a part of.
  std::size_t whole(std::size_t t) const {
    return t < whole_triangles() ? t : std::size_t(cut.triangles[t - whole_triangles()].whole);
  }
  bool is_own(std::size_t t) const { return whole(t) < own_triangles(); }
  // bends: as bends_. Parts may bend if any may.
  bool may_bend(std::size_t t, const std::vector<std::uint8_t>& bends) const {
    return !bends.empty() && is_own(t) && (t >= own_triangles() || bends[t]);
  }
};

struct Rasterizer::Work {
  std::vector<SampleCell> cells;         // they name triangles by their index in the next
  std::vector<DrawnTriangle> triangles;  // of a band
  std::vector<std::uint8_t> bends;       // whether each may be curved
  // Parts wait until there are enough to be interpolated together.
  static constexpr std::size_t kParts = 128;
  TrianglePart parts[kParts];
  std::size_t waiting = 0;
};

Rasterizer::Rasterizer() = default;
Rasterizer::~Rasterizer() = default;

std::unique_ptr<Rasterizer::Work> Rasterizer::borrow() {
  const std::lock_guard lock(idle_mutex_);
  if (idle_.empty()) return std::make_unique<Work>();
  std::unique_ptr<Work> work = std::move(idle_.back());
  idle_.pop_back();
  return work;
}

void Rasterizer::give_back(std::unique_ptr<Work> work) {
  const std::lock_guard lock(idle_mutex_);
  idle_.push_back(std::move(work));
}

void Rasterizer::project(const Geometry& g, const Pose& camera_from_marker) {
  const Pose camera_from_object = camera_from_marker * g.scene.marker_from_object;
  const Lens lens(g.camera);
  corners_.resize(g.own() + g.holdout.vertices.size());
  parallel_for(int(corners_.size()), kVertices, [&](int begin, int end) {
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const glm::dvec3 p = i < g.own()
                               ? camera_from_object * glm::dvec3(g.scene.mesh.vertices[i])
                               : camera_from_marker * glm::dvec3(g.holdout.vertices[i - g.own()]);
      corners_[i] = picture_corner(lens, p);
    }
  });
}

// Cuts what reaches behind the camera or beyond the lens model, and splits what the lens bends.
void Rasterizer::cut(Geometry& g, const Pose& camera_from_marker) {
  cut_ = {};
  const double least = least_bent_.of(g.camera);
  const auto cut_one = [&](const Mesh& mesh, const Pose& camera_from_mesh, std::size_t first_vertex,
                           std::size_t first_triangle) {
    PictureCorner* const corners = corners_.data() + first_vertex;
    const std::size_t n = mesh.vertices.size();
    if (std::all_of(corners, corners + n, [](const PictureCorner& c) { return c.valid; }) &&
        !may_be_bent(mesh, camera_from_mesh, least))
      return;
    cut_.replaced.resize(g.whole_triangles());
    const CutMesh made = cut_to_view(mesh, ViewVolume(mesh, g.camera, camera_from_mesh, least));
    for (std::size_t i = 0; i < made.replaced.size(); ++i)
      cut_.replaced[first_triangle + i] = made.replaced[i];
    const Lens lens(g.camera);  // made here, not for every picture: how far it goes is searched for
    const int shift = int(g.vertices() + cut_.vertices.size()) - int(n);
    const auto numbered = [&](int vertex) {
      return vertex + (std::size_t(vertex) < n ? int(first_vertex) : shift);
    };
    for (CutMesh::Triangle t : made.triangles) {
      for (int k = 0; k < 3; ++k) t.corners[k] = numbered(t.corners[k]);
      t.whole += int(first_triangle);
      cut_.triangles.push_back(t);
    }
    for (CutMesh::Vertex v : made.vertices) {
      corners_.push_back(picture_corner(lens, camera_from_mesh * v.position));
      v.triangle += int(first_triangle);
      cut_.vertices.push_back(v);
    }
  };
  cut_one(g.scene.mesh, camera_from_marker * g.scene.marker_from_object, 0, 0);
  cut_one(g.holdout, camera_from_marker, g.own(), g.own_triangles());
  if (cut_.vertices.empty()) return;
  // Values of the vertices from `first` on, and of the new ones after them.
  const auto extend = [&](auto& values, std::size_t first, auto& all) {
    if (values.empty()) return;
    all.assign(values.begin(), values.end());
    all.resize(corners_.size() - first);
    for (std::size_t i = 0; i < cut_.vertices.size(); ++i) {
      const CutMesh::Vertex& v = cut_.vertices[i];
      if ((std::size_t(v.triangle) < g.own_triangles()) == (first == 0))
        all[g.vertices() + i - first] =
            v.mean(g.corners_of(std::size_t(v.triangle)) - int(first), values.data());
    }
    values = all;
  };
  extend(g.back_shares, 0, cut_back_shares_);
  extend(g.holdout_ratios, g.own(), cut_holdout_ratios_);
  extend(g.colors, 0, cut_colors_);
}

// The pixels that lie among the corners.
void Rasterizer::set_window(const Camera& camera) {
  left_ = camera.width, right_ = -1, top_ = camera.height, bottom_ = -1;
  for (const PictureCorner& corner : corners_) {
    if (!corner.valid) continue;
    const int x = int(corner.x / kSubpixel), y = int(corner.y / kSubpixel);
    left_ = std::min(left_, x - 1), right_ = std::max(right_, x + 1);
    top_ = std::min(top_, y - 1), bottom_ = std::max(bottom_, y + 1);
  }
  left_ = std::max(left_, 0), right_ = std::min(right_, camera.width - 1);
  top_ = std::max(top_, 0), bottom_ = std::min(bottom_, camera.height - 1);
}

void Rasterizer::set_varyings(const Geometry& g, std::span<const glm::vec4> light_shares) {
  const Scene& scene = g.scene;
  const glm::mat3 marker_from_object(scene.marker_from_object.rotation);
  const std::vector<glm::vec3>& normals = scene.shown_normals();
  varyings_.resize(scene.mesh.vertices.size());
  parallel_for(int(varyings_.size()), kVertices, [&](int begin, int end) {
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      Varying& v = varyings_[i];
      v.position = glm::vec3(scene.marker_from_object * glm::dvec3(scene.mesh.vertices[i]));
      if (glm::any(glm::isinf(v.position))) corners_[i].valid = false;  // beyond floats: not drawn
      v.normal = marker_from_object * normals[i];
      v.share =
          light_shares.empty() ? glm::vec4(glm::vec3(scene.visibility[i]), 1) : light_shares[i];
      v.tangent =
          scene.tangents.empty()
              ? glm::vec4(0)
              : glm::vec4(marker_from_object * glm::vec3(scene.tangents[i]), scene.tangents[i].w);
      v.uv = scene.mesh.uvs.empty() ? glm::vec2(0) : scene.mesh.uvs[i];
    }
  });
  if (cut_.vertices.empty()) return;
  varyings_.resize(corners_.size());
  for (std::size_t i = 0; i < cut_.vertices.size(); ++i) {
    const CutMesh::Vertex& v = cut_.vertices[i];
    if (!g.is_own(std::size_t(v.triangle))) continue;
    const glm::ivec3& corners = scene.mesh.triangles[std::size_t(v.triangle)];
    Varying& mean = varyings_[g.vertices() + i];
    mean = {};
    for (int k = 0; k < 3; ++k) {
      const float w = v.weights[k];
      const Varying& corner = varyings_[std::size_t(corners[k])];
      mean.position += w * corner.position, mean.normal += w * corner.normal;
      mean.share += w * corner.share, mean.tangent += w * corner.tangent, mean.uv += w * corner.uv;
    }
    if (!std::isfinite(glm::dot(mean.position, glm::vec3(1))))
      corners_[g.vertices() + i].valid = false;
  }
}

void Rasterizer::sort_triangles(const Geometry& g, int bands) {
  if (triangles_of_.size() < std::size_t(bands)) triangles_of_.resize(std::size_t(bands));
  for (std::vector<int>& triangles : triangles_of_) triangles.clear();
  bends_.resize(g.curved_cosine > kNever ? g.own_triangles() : 0);
  for (std::size_t i = 0; i < g.triangles(); ++i) {
    if (i < cut_.replaced.size() && cut_.replaced[i]) continue;
    const glm::ivec3 index = g.corners_of(i);
    const PictureCorner &a = corners_[std::size_t(index[0])], &b = corners_[std::size_t(index[1])],
                        &c = corners_[std::size_t(index[2])];
    if (!a.valid || !b.valid || !c.valid) continue;
    if (g.fronts_only && g.is_own(i) && is_back(a, b, c)) continue;
    if (i < bends_.size()) {
      const glm::vec3 &n0 = g.scene.normals[std::size_t(index[0])],
                      &n1 = g.scene.normals[std::size_t(index[1])],
                      &n2 = g.scene.normals[std::size_t(index[2])];
      const float least = std::min({glm::dot(n0, n1), glm::dot(n1, n2), glm::dot(n2, n0)});
      bends_[i] = may_bend(a, b, c, least, g.curved_cosine);
    }
    const int y0 = std::max(int(std::min({a.y, b.y, c.y}) / kSubpixel) - top_, 0) / kBand;
    const int y1 = std::min(int(std::max({a.y, b.y, c.y}) / kSubpixel), bottom_) - top_;
    for (int band = y0; band <= y1 / kBand && y1 >= 0; ++band)
      triangles_of_[std::size_t(band)].push_back(int(i));
  }
}

namespace {

// `a` becomes the mean of both, weighted by what they cover.
void merge(Fragment& a, const Fragment& b) {
  const float t = b.coverage / (a.coverage + b.coverage);
  a.coverage += b.coverage;
  a.position = glm::mix(a.position, b.position, t);  // the difference may be beyond numbers
  a.normal = glm::normalize(a.normal + t * (b.normal - a.normal));
  a.share += t * (b.share - a.share);
  a.tangent += t * (b.tangent - a.tangent);
  a.color += t * (b.color - a.color);
}

// Merges the fragments of one pixel whose normals hardly differ, so that they are shaded once: of a
// fine mesh half of all pixels show two triangles or more.
void append(const Fragment& f, float alike_cosine, std::vector<Fragment>& fragments) {
  if (alike_cosine <= 1)
    for (std::size_t k = fragments.size(); k-- > 0;) {
      Fragment& before = fragments[k];
      if (before.x != f.x || before.y != f.y) break;
      if (glm::dot(before.normal, f.normal) >= alike_cosine) return merge(before, f);
    }
  fragments.push_back(f);
}

}  // namespace

void merge_alike(const Material& material, std::span<FragmentBand> bands) {
  const float cosine = alike_cosine(material);
  if (cosine > 1) return;
  parallel_for(int(bands.size()), 4, [&](int begin, int end) {
    std::vector<Fragment> merged;
    for (int i = begin; i < end; ++i) {
      std::vector<Fragment>& fragments = bands[std::size_t(i)].object;
      merged.clear();
      for (const Fragment& f : fragments) append(f, cosine, merged);
      fragments.swap(merged);
    }
  });
}

void Rasterizer::add(const Geometry& g, const TrianglePart& part, Work& work,
                     FragmentBand& band) const {
  const DrawnTriangle& t = work.triangles[std::size_t(part.triangle)];
  if (std::size_t(t.name) < g.own_triangles()) {
    work.parts[work.waiting++] = part;
    if (work.waiting == Work::kParts) flush(g, work, band);
    return;
  }
  glm::vec3 ratio(1);
  if (!g.holdout_ratios.empty()) {
    const glm::vec3 w = t.shares(part.picture_x(), part.picture_y());
    ratio = glm::vec3(0);
    for (int k = 0; k < 3; ++k)
      ratio += w[k] * glm::vec3(g.holdout_ratios[std::size_t(t.corners[k]) - g.own()]);
  }
  band.holdouts.push_back({part.x, part.y, float(part.count) / kSamples, ratio});
}

void Rasterizer::flush(const Geometry& g, Work& work, FragmentBand& band) const {
  Varying means[Work::kParts];
  interpolate({work.parts, work.waiting}, work.triangles.data(), varyings_.data(), means);
  for (std::size_t i = 0; i < work.waiting; ++i) {
    const TrianglePart& part = work.parts[i];
    const DrawnTriangle& t = work.triangles[std::size_t(part.triangle)];
    Fragment f{means[i]};
    f.x = part.x, f.y = part.y, f.triangle = t.name, f.coverage = float(part.count) / kSamples;
    const auto corner = [&](int k) { return std::size_t(t.corners[k]); };
    const auto here = [&](const auto& values) {  // interpolated between the corners' values
      const glm::vec3 w = t.shares(part.picture_x(), part.picture_y());
      return w.x * values[corner(0)] + w.y * values[corner(1)] + w.z * values[corner(2)];
    };
    if (g.surface) f.tangent.w = f.tangent.w < 0 ? -1 : 1;
    if (!g.fronts_only && is_back(corners_[corner(0)], corners_[corner(1)], corners_[corner(2)])) {
      f.normal = -f.normal, f.tangent = -f.tangent;  // what is a bump is a dent from here
      if (!g.back_shares.empty()) f.share = here(g.back_shares);
    }
    if (!g.colors.empty()) f.color = here(g.colors);
    const float length = glm::length(f.normal);
    f.normal = length > 0 ? f.normal * (1 / length) : glm::vec3(0, 0, 1);
    if (g.textured) {
      const auto uv_at = [&](std::int64_t px, std::int64_t py) {
        const glm::vec3 w = t.shares(px, py);
        return w.x * varyings_[corner(0)].uv + w.y * varyings_[corner(1)].uv +
               w.z * varyings_[corner(2)].uv;
      };
      f.uv_dx = uv_at(part.picture_x() + kSubpixel, part.picture_y()) - f.uv;
      f.uv_dy = uv_at(part.picture_x(), part.picture_y() + kSubpixel) - f.uv;
    }
    append(f, g.alike_cosine, band.object);
  }
  band.found += double(work.waiting);
  work.waiting = 0;
}

bool Rasterizer::is_curved(const Geometry& g, const DrawnTriangle& t, const TrianglePart& part,
                           const SampleCell& cell) const {
  const glm::vec3 &n0 = varyings_[std::size_t(t.corners[0])].normal,
                  &n1 = varyings_[std::size_t(t.corners[1])].normal,
                  &n2 = varyings_[std::size_t(t.corners[2])].normal;
  glm::vec3 at[kSamples];
  int count = 0;
  for (std::size_t k = 0; k < kSamples; ++k) {
    if (cell.triangle[k] != part.triangle) continue;
    const glm::vec3 w = t.shares(std::int64_t{part.x} * kSubpixel + kSampleX[k],
                                 std::int64_t{part.y} * kSubpixel + kSampleY[k]);
    const glm::vec3 n = glm::normalize(w.x * n0 + w.y * n1 + w.z * n2);
    for (int j = 0; j < count; ++j)
      if (glm::dot(at[j], n) < g.curved_cosine) return true;
    at[count++] = n;
  }
  return false;
}

// One fragment a triangle, at the middle of the samples that it covers; where it is curved, one at
// each of them.
void Rasterizer::resolve(const Geometry& g, const SampleWindow& window, Work& work,
                         FragmentBand& band) const {
  constexpr int kMiddle = kSubpixel / 2;
  const SampleCell* cell = window.cells;
  for (int y = window.top; y <= window.bottom; ++y)
    for (int x = window.left; x <= window.right; ++x, ++cell) {
      const std::array<std::int32_t, kSamples>& seen = cell->triangle;
      const bool alike = seen[0] == seen[1] && seen[0] == seen[2] && seen[0] == seen[3];
      if (alike && seen[0] < 0) continue;
      if (alike && !work.bends[std::size_t(seen[0])]) {
        add(g, {seen[0], x, y, kSamples, kMiddle, kMiddle}, work, band);
        continue;
      }
      int asked = -1;  // the triangle that `curved` is of
      bool curved = false;
      for (std::size_t s = 0; s < kSamples; ++s) {
        if (seen[s] < 0) continue;
        TrianglePart part{seen[s], x, y, 0, 0, 0};
        bool before = false;
        for (std::size_t k = 0; k < kSamples; ++k) {
          if (seen[k] != seen[s]) continue;
          before = before || k < s;
          part.px += kSampleX[k], part.py += kSampleY[k], ++part.count;
        }
        part.px /= part.count, part.py /= part.count;
        if (part.count > 1 && work.bends[std::size_t(seen[s])]) {
          if (seen[s] != asked) {
            asked = seen[s];
            curved = is_curved(g, work.triangles[std::size_t(asked)], part, *cell);
          }
          if (curved) part.count = 1, part.px = kSampleX[s], part.py = kSampleY[s], before = false;
        }
        if (!before) add(g, part, work, band);
      }
    }
  flush(g, work, band);
}

std::span<FragmentBand> Rasterizer::rasterize(const Scene& scene, const Camera& camera,
                                              const Pose& camera_from_marker,
                                              std::span<const glm::vec4> light_shares,
                                              std::span<const glm::vec4> holdout_ratios,
                                              bool merge) {
  const std::size_t own = scene.mesh.vertices.size();
  check(light_shares.empty() || light_shares.size() == own || light_shares.size() == 2 * own,
        "there must be a share of the light for each vertex, or each side of them, ", own, ", got ",
        light_shares.size());
  static const Mesh kNone;
  const Mesh& holdout = scene.has_holdouts() ? scene.holdouts->mesh : kNone;
  check(holdout_ratios.empty() || holdout_ratios.size() == holdout.vertices.size(),
        "there must be a ratio for each vertex of the holdouts, ", holdout.vertices.size(),
        ", got ", holdout_ratios.size());
  const glm::dvec3 eye = (camera_from_marker * scene.marker_from_object).inverse().translation;
  Geometry geometry{scene,
                    camera,
                    holdout,
                    light_shares.subspan(std::min(own, light_shares.size())),
                    holdout_ratios,
                    scene.mesh.colors,
                    scene.fronts_only && !is_inside(bounds(scene.mesh.vertices), eye),
                    !scene.tangents.empty() && scene.material.pbr != nullptr,
                    !scene.mesh.uvs.empty() && scene.material.textured(),
                    merge ? alike_cosine(scene.material) : kNoneAlike,
                    curved_cosine(scene.material),
                    cut_};
  project(geometry, camera_from_marker);
  cut(geometry, camera_from_marker);
  set_window(camera);
  if (left_ > right_ || top_ > bottom_) return {};
  set_varyings(geometry, light_shares);
  const int width = right_ - left_ + 1, bands = (bottom_ - top_) / kBand + 1;
  sort_triangles(geometry, bands);
  if (found_.size() < std::size_t(bands)) found_.resize(std::size_t(bands));
  parallel_for(bands, 1, [&](int begin, int end) {
    std::unique_ptr<Work> borrowed = borrow();
    Work& work = *borrowed;
    for (int i = begin; i < end; ++i) {
      FragmentBand& band = found_[std::size_t(i)];
      band.object.clear(), band.holdouts.clear(), band.found = 0;
      if (triangles_of_[std::size_t(i)].empty()) continue;
      const int top = top_ + i * kBand, bottom = std::min(top + kBand - 1, bottom_);
      work.cells.assign(std::size_t(width) * kBand, SampleCell{});
      const SampleWindow window{work.cells.data(), left_, top, right_, bottom};
      work.triangles.clear(), work.bends.clear();
      for (const int t : triangles_of_[std::size_t(i)]) {
        const glm::ivec3 index = geometry.corners_of(std::size_t(t));
        const PictureCorner &a = corners_[std::size_t(index[0])],
                            &b = corners_[std::size_t(index[1])],
                            &c = corners_[std::size_t(index[2])];
        if (edge(a, b, c.x, c.y) == 0) continue;
        fill_triangle(window, a, b, c, int(work.triangles.size()));
        work.triangles.emplace_back(int(geometry.whole(std::size_t(t))), index, a, b, c);
        work.bends.push_back(geometry.may_bend(std::size_t(t), bends_));
      }
      resolve(geometry, window, work, band);
    }
    give_back(std::move(borrowed));
  });
  return std::span(found_).first(std::size_t(bands));
}

}  // namespace fastibl
