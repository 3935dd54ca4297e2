#include "fastibl/tracking/refine.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/scene/tag_codes.h"
#include "fastibl/scene/wide_lens.h"

namespace fastibl {
namespace {

constexpr double kSideStart = 0.08;      // part of a side left out at either corner: blurred round
constexpr double kSharp = 0.55;          // 1 / px: steepness, of edges in sharp pictures
constexpr double kBeside = 0.25;         // modules left out beside a white one
constexpr double kLeastBacked = 0.2;     // of a side, to be measured there alone
constexpr double kSmallestBorder = 1.7;  // px; narrower ones hold no black level
constexpr double kClear = 1.5;  // px kept from data modules, whose blur lifts the black level
constexpr double kStep = 0.5;   // px between samples of a profile
constexpr int kMostSteps = 32;
constexpr int kParts = 6;  // of a side, whose scatter about its line tells how well that is known
// How far blur moves sides outwards, px, by the share of its deviation in the narrowest border: of
// what is measured in films with borders of 2 to 7 px and deviations of 0.65 to 1.2.
constexpr double kLift = 1.3, kLiftPower = 2.7;

// White that blur brings behind a border of that width lifts the black level. steepness: 1 / px, of
// a normal profile.
double lift_of(double steepness, double border) {
  const double deviation = 0.4 / steepness;  // 1 / sqrt(2 pi)
  return kLift * std::pow(std::min(1.0, deviation / border), kLiftPower);
}

// Where a position on the plane is seen, and how it maps to pixels nearby.
struct Local {
  glm::dvec2 pixel;
  glm::dmat2 pixel_from_ideal;
};

struct Line {
  glm::dvec2 point, direction;  // on the plane; direction of unit length
  double variance = 0;          // of its offset in the middle, as its points' scatter tells
};

struct SidePoint {
  double along, offset;  // in units of the plane
};

struct Edge {
  double offset;     // px from the middle of the profile
  double steepness;  // 1 / px: largest slope by the step from black to white
};

// The unit square on a tag's four corners; Heckbert 1989, Fundamentals of Texture Mapping, 2.2.3.
struct SquareMap {
  glm::dvec2 origin, u, v;  // numerators, beside 1 + g·(x, y)
  double g, h;

  explicit SquareMap(const std::array<glm::dvec2, 4>& c) : origin(c[0]) {
    const glm::dvec2 d1 = c[1] - c[2], d2 = c[3] - c[2], s = c[0] - c[1] + c[2] - c[3];
    const double det = d1.x * d2.y - d1.y * d2.x;
    g = (s.x * d2.y - s.y * d2.x) / det;
    h = (d1.x * s.y - d1.y * s.x) / det;
    u = c[1] - c[0] + g * c[1];
    v = c[3] - c[0] + h * c[3];
  }
  glm::dvec2 operator()(const glm::dvec2& p) const {
    return (origin + p.x * u + p.y * v) / (1 + g * p.x + h * p.y);
  }
};

// Point of the unit square `along` a side (0: from corner 0 to 1), `in` inside it.
glm::dvec2 on_side(std::size_t side, double along, double in) {
  switch (side) {
    case 0:
      return {along, in};
    case 1:
      return {1 - in, along};
    case 2:
      return {1 - along, 1 - in};
    default:
      return {in, 1 - along};
  }
}

// Parts of a side that are measured. In blurred pictures, only those with more black behind the
// border: elsewhere white modules lift the black level, and the edge would be found too far out.
class Measured {
  struct Part {
    double from, to;
  };

 public:
  Measured() = default;  // all of it
  // All of it, too, where there is too little black, or the id is none of the family.
  Measured(int id, int border_bits, std::size_t side) {
    const int n = kTagModules + 2 * border_bits;
    const auto black = [&](int module) {
      const int k = module - border_bits, last = kTagModules - 1;
      if (k < 0 || k > last) return true;  // the border of the next side
      switch (side) {
        case 0:
          return tag_module_black(id, 0, k);
        case 1:
          return tag_module_black(id, k, last);
        case 2:
          return tag_module_black(id, last, last - k);
        default:
          return tag_module_black(id, last - k, 0);
      }
    };
    const auto clipped = [](double along) { return std::clamp(along, kSideStart, 1 - kSideStart); };
    std::vector<Part> parts;
    double length = 0;
    if (id >= 0 && id < kTagCount)
      for (int first = 0, end; first < n; first = end) {
        for (end = first; end < n && black(end);) ++end;
        const double from = clipped((first == 0 ? first : first + kBeside) / n),
                     to = clipped((end == n ? end : end - kBeside) / n);
        if (to > from) parts.push_back({from, to}), length += to - from;
        if (end == first) ++end;
      }
    if (length >= kLeastBacked) parts_ = std::move(parts), length_ = length;
  }
  // The place along the side, 0 to 1, at a share of what is measured.
  double at(double share) const {
    double rest = share * length_;
    for (const Part& part : parts_) {
      if (rest <= part.to - part.from) return part.from + rest;
      rest -= part.to - part.from;
    }
    return parts_.back().to;
  }

 private:
  std::vector<Part> parts_{{kSideStart, 1 - kSideStart}};
  double length_ = 1 - 2 * kSideStart;
};

// The plane z = 1 before a perspective camera.
class ImagePlane {
 public:
  explicit ImagePlane(const Camera& camera) : camera_(camera), lens_(camera) {}
  std::optional<glm::dvec2> ideal(const glm::dvec2& pixel) const {
    const auto ray = lens_.unproject(pixel);
    return ray ? std::optional(glm::dvec2(*ray)) : std::nullopt;
  }
  bool valid(const glm::dvec2& ideal) const { return lens_.valid(ideal); }
  Local local(const glm::dvec2& ideal) const {
    Local result;
    glm::dmat2 d(1.0);
    const glm::dvec2 p = lens_.distort(ideal, &d);
    result.pixel = {camera_.fx * p.x + camera_.cx, camera_.fy * p.y + camera_.cy};
    result.pixel_from_ideal = glm::dmat2(camera_.fx, 0, 0, camera_.fy) * d;
    return result;
  }

 private:
  const Camera& camera_;
  Lens lens_;
};

// The plane that touches the unit sphere where a camera that sees far aside sees a tag.
class TangentPlane {
 public:
  TangentPlane(const WideLens& lens, const DetectedTag& tag) : lens_(lens) {
    glm::dvec3 sum(0);
    for (const glm::dvec2& corner : tag.corners)
      if (const auto ray = lens.unproject(corner)) sum += glm::normalize(*ray);
    if (!(glm::length(sum) > 0)) return;
    const glm::dvec3 axis = glm::normalize(sum);
    const glm::dvec3 right = glm::normalize(
        glm::cross(std::abs(axis.y) < 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0), axis));
    from_plane_ = glm::dmat3(right, glm::cross(axis, right), axis);
  }
  std::optional<glm::dvec2> ideal(const glm::dvec2& pixel) const {
    const auto ray = lens_.unproject(pixel);
    if (!ray) return std::nullopt;
    const glm::dvec3 r = *ray * from_plane_;
    if (!(r.z > 0)) return std::nullopt;
    return glm::dvec2(r) / r.z;
  }
  bool valid(const glm::dvec2& ideal) const { return pixel(ideal).has_value(); }
  Local local(const glm::dvec2& ideal) const {
    constexpr double kStepAside = 1e-5;
    const auto at = [&](double x, double y) {
      return pixel(ideal + glm::dvec2(x, y)).value_or(glm::dvec2(std::nan("")));
    };
    const double scale = 0.5 / kStepAside;
    return {at(0, 0),
            {scale * (at(kStepAside, 0) - at(-kStepAside, 0)),
             scale * (at(0, kStepAside) - at(0, -kStepAside))}};
  }

 private:
  std::optional<glm::dvec2> pixel(const glm::dvec2& ideal) const {
    return lens_.project(from_plane_ * glm::dvec3(ideal, 1));
  }
  const WideLens& lens_;
  glm::dmat3 from_plane_{1.0};
};

// Plane: on which the board's lines are straight.
template <typename Plane>
class Refiner {
 public:
  Refiner(ImageView<const std::uint8_t> grey, const Camera& camera, const Plane& plane,
          const ByteResponse& table, const RefineOptions& options)
      : grey_(grey), camera_(camera), plane_(plane), options_(options), table_(table) {}

  std::optional<RefinedTag> refine(const DetectedTag& tag, int border_bits) const {
    std::array<glm::dvec2, 4> ideal;
    for (std::size_t i = 0; i < 4; ++i) {
      const auto at = plane_.ideal(tag.corners[i]);
      if (!at) return std::nullopt;
      ideal[i] = *at;
    }
    bool sharp = true;
    SideErrors errors;
    std::vector<double> steepness;
    for (int round = 0; round < options_.rounds; ++round) {
      const SquareMap map(ideal);
      steepness.clear();
      std::array<Line, 4> sides;
      double variance = 0, narrowest = 1e9;
      for (std::size_t i = 0; i < 4; ++i) {
        const double border = border_px(map, i, border_bits / (kTagModules + 2.0 * border_bits));
        // The first round has to reach the edge, the others must not reach the data behind it.
        const double reach = std::min(round == 0 ? border - 0.5 : std::max(1.25, border - kClear),
                                      options_.reach_px);
        if (!(border > kSmallestBorder)) return std::nullopt;
        const Measured measured = sharp ? Measured() : Measured(tag.id, border_bits, i);
        const auto line = fit_side(map, i, measured, reach, steepness);
        if (!line) return std::nullopt;
        sides[i] = *line;
        variance += 0.25 * line->variance, narrowest = std::min(narrowest, border);
      }
      for (std::size_t i = 0; i < 4; ++i) {
        const auto corner = meet(sides[(i + 3) % 4], sides[i]);
        if (!corner || !plane_.valid(*corner)) return std::nullopt;
        ideal[i] = *corner;
      }
      const auto middle = steepness.begin() + std::ptrdiff_t(steepness.size() / 2);
      std::nth_element(steepness.begin(), middle, steepness.end());
      sharp = *middle > kSharp;
      errors = {std::sqrt(variance), lift_of(*middle, narrowest)};
    }
    DetectedTag out{tag.id, {}};
    for (std::size_t i = 0; i < 4; ++i) {
      out.corners[i] = plane_.local(ideal[i]).pixel;
      const double side = glm::length(tag.corners[(i + 1) % 4] - tag.corners[i]);
      const double move = glm::length(out.corners[i] - tag.corners[i]);
      if (!(move <= std::max(2.0, options_.longest_move * side))) return std::nullopt;
    }
    return RefinedTag{out, errors};
  }

 private:
  // Width in pixels of the black border beside a side, and of as much white outside it, where they
  // are narrowest: perspective makes far modules smaller.
  double border_px(const SquareMap& tag, std::size_t side, double border) const {
    double narrowest = 1e9;
    for (const double along : {kSideStart, 0.5, 1 - kSideStart}) {
      const glm::dvec2 a = plane_.local(tag(on_side(side, along, 0))).pixel;
      const glm::dvec2 b = plane_.local(tag(on_side(side, along + 0.01, 0))).pixel;
      const glm::dvec2 t = glm::normalize(b - a);
      for (const double in : {border, -border}) {
        const glm::dvec2 d = plane_.local(tag(on_side(side, along, in))).pixel - a;
        narrowest = std::min(narrowest, std::abs(t.x * d.y - t.y * d.x));
      }
    }
    return narrowest;
  }

  // Linear value between pixel centres, which are at + 0.5.
  double sample(const glm::dvec2& pixel) const {
    const double x = pixel.x - 0.5, y = pixel.y - 0.5;
    const int ix = int(x), iy = int(y);
    const double fx = x - ix, fy = y - iy;
    const std::uint8_t *a = grey_.row(iy) + ix, *b = grey_.row(iy + 1) + ix;
    return (1 - fy) * ((1 - fx) * table_.decode(a[0]) + fx * table_.decode(a[1])) +
           fy * ((1 - fx) * table_.decode(b[0]) + fx * table_.decode(b[1]));
  }
  bool reachable(const glm::dvec2& p) const {
    return p.x >= 0.5 && p.y >= 0.5 && p.x < grey_.width - 0.5 - 1e-9 &&
           p.y < grey_.height - 0.5 - 1e-9;
  }

  // Pixels from the middle of the profile to the edge; `out` points from black to white. With I
  // rising from I_b at −h to I_w at +h, ∫ (I − I_b)/(I_w − I_b) ds = h − s for an edge at s.
  std::optional<Edge> edge_of(const glm::dvec2& middle, const glm::dvec2& out, double reach) const {
    if (!reachable(middle - reach * out) || !reachable(middle + reach * out)) return std::nullopt;
    const int steps = std::min(kMostSteps, 2 * std::max(2, int(std::lround(reach / kStep))));
    std::array<double, kMostSteps + 1> value;
    const double step = 2 * reach / steps;
    for (int k = 0; k <= steps; ++k)
      value[std::size_t(k)] = sample(middle + (k * step - reach) * out);
    const int level = std::max(1, steps / 6);  // samples averaged at either end for the levels
    double black = 0, white = 0, area = 0;
    for (int k = 0; k < level; ++k)
      black += value[std::size_t(k)], white += value[std::size_t(steps - k)];
    black /= level, white /= level;
    // Shadows, glare and neighbouring ink leave no clear step; their offsets would be made up.
    if (!(white - black > 0.25 * white) || !(white - black > 2e-3)) return std::nullopt;
    for (int k = 0; k <= steps; ++k)  // trapezium
      area += (k == 0 || k == steps ? 0.5 : 1.0) * value[std::size_t(k)];
    const double offset = reach - step * (area - steps * black) / (white - black);
    if (std::abs(offset) > 0.75 * reach) return std::nullopt;
    double steepest = 0;
    for (int k = 1; k <= steps; ++k)
      steepest = std::max(steepest, value[std::size_t(k)] - value[std::size_t(k - 1)]);
    return Edge{offset, steepest / (step * (white - black))};
  }

  // Line through the edge points between two corners; black is on the right of a → b, as corners
  // run clockwise in the picture.
  std::optional<Line> fit_side(const SquareMap& tag, std::size_t index, const Measured& measured,
                               double reach, std::vector<double>& steepness) const {
    const glm::dvec2 a = tag(on_side(index, 0, 0)), side = tag(on_side(index, 1, 0)) - a;
    const double length = glm::length(side);
    if (!(length > 0 && length < 1e6)) return std::nullopt;  // nor NaN
    const glm::dvec2 t = side / length, n(t.y, -t.x);
    const double pixels = length * camera_.fx;
    const int count = int(std::clamp(pixels, 8.0, double(options_.most_samples)));
    std::vector<SidePoint> points;
    points.reserve(std::size_t(count));
    for (int i = 0; i < count; ++i) {
      const glm::dvec2 ideal = tag(on_side(index, measured.at((i + 0.5) / count), 0));
      if (!plane_.valid(ideal)) continue;
      const Local at = plane_.local(ideal);
      const glm::dvec2 tangent = glm::normalize(at.pixel_from_ideal * t);
      const glm::dvec2 out(tangent.y, -tangent.x);
      const auto edge = edge_of(at.pixel, out, reach);
      if (!edge) continue;
      steepness.push_back(edge->steepness);
      const glm::dvec2 delta = glm::inverse(at.pixel_from_ideal) * (edge->offset * out);
      points.push_back({glm::dot(ideal - a + delta, t), glm::dot(delta, n)});
    }
    if (int(points.size()) < std::max(5, count / 2)) return std::nullopt;
    auto line = robust_line(points, a, t, n);
    if (line) {  // in pixels
      const glm::dmat2 d = plane_.local(line->point).pixel_from_ideal;
      const double across = std::abs(glm::determinant(d)) / glm::length(d * t);
      line->variance *= across * across;
    }
    return line;
  }

  static std::optional<Line> robust_line(const std::vector<SidePoint>& points, const glm::dvec2& a,
                                         const glm::dvec2& t, const glm::dvec2& n) {
    std::vector<double> weight(points.size(), 1.0), residual(points.size());
    double slope = 0, middle = 0, centre = 0;
    for (int round = 0; round < 4; ++round) {
      double w = 0, x = 0, y = 0, xx = 0, xy = 0;
      for (std::size_t i = 0; i < points.size(); ++i)
        w += weight[i], x += weight[i] * points[i].along, y += weight[i] * points[i].offset;
      if (!(w > 2)) return std::nullopt;
      centre = x / w, middle = y / w;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double d = points[i].along - centre;
        xx += weight[i] * d * d, xy += weight[i] * d * (points[i].offset - middle);
      }
      if (!(xx > 0)) return std::nullopt;
      slope = xy / xx;
      for (std::size_t i = 0; i < points.size(); ++i)
        residual[i] = points[i].offset - middle - slope * (points[i].along - centre);
      std::vector<double> sizes(residual.size());
      std::transform(residual.begin(), residual.end(), sizes.begin(),
                     [](double r) { return std::abs(r); });
      std::nth_element(sizes.begin(), sizes.begin() + std::ptrdiff_t(sizes.size() / 2),
                       sizes.end());
      // Tukey's biweight at 4.685 standard deviations (1.4826 medians); the floor keeps exact
      // profiles from dividing by zero.
      const double cut = std::max(4.685 * 1.4826 * sizes[sizes.size() / 2], 1e-9);
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double q = residual[i] / cut;
        weight[i] = std::abs(q) < 1 ? (1 - q * q) * (1 - q * q) : 0;
      }
    }
    return Line{a + centre * t + middle * n, glm::normalize(t + slope * n),
                variance_of_mean(weight, residual)};
  }

  // Of the points' mean, from the scatter of the means of parts about the fitted line: neighbouring
  // points share pixels, and what bends a side is in it, too.
  static double variance_of_mean(const std::vector<double>& weight,
                                 const std::vector<double>& residual) {
    double all = 0, squares = 0;
    for (int part = 0; part < kParts; ++part) {
      const std::size_t n = weight.size(), from = n * std::size_t(part) / kParts,
                        to = n * std::size_t(part + 1) / kParts;
      double w = 0, sum = 0;
      for (std::size_t i = from; i < to; ++i) w += weight[i], sum += weight[i] * residual[i];
      all += w;
      if (w > 0) squares += sum * sum / w;
    }
    return squares / ((kParts - 2) * all);
  }

  static std::optional<glm::dvec2> meet(const Line& a, const Line& b) {
    const double det = a.direction.x * b.direction.y - a.direction.y * b.direction.x;
    if (std::abs(det) < 1e-3) return std::nullopt;  // nearly parallel sides: seen edge-on
    const glm::dvec2 d = b.point - a.point;
    return a.point + (d.x * b.direction.y - d.y * b.direction.x) / det * a.direction;
  }

  ImageView<const std::uint8_t> grey_;
  const Camera& camera_;
  const Plane& plane_;
  RefineOptions options_;
  const ByteResponse& table_;
};

}  // namespace

std::vector<RefinedTag> refine_tags(ImageView<const std::uint8_t> grey,
                                    const std::vector<DetectedTag>& tags, int border_bits,
                                    const Camera& camera, const RefineOptions& options) {
  check(grey.channels == 1 && grey.width == camera.width && grey.height == camera.height,
        "refine_corners needs a grey picture of the camera's size ", camera.width, " × ",
        camera.height, ", got ", grey.width, " × ", grey.height, " with ", grey.channels,
        " channels");
  const ByteResponse table(camera.response);
  std::vector<RefinedTag> out;
  out.reserve(tags.size());
  const auto refined = [&](const DetectedTag& tag, const auto& plane) {
    return Refiner(grey, camera, plane, table, options)
        .refine(tag, border_bits)
        .value_or(RefinedTag{tag, {}});
  };
  if (camera.model == CameraModel::perspective) {
    const ImagePlane plane(camera);
    for (const DetectedTag& tag : tags) out.push_back(refined(tag, plane));
  } else {
    const WideLens lens(camera);
    for (const DetectedTag& tag : tags) out.push_back(refined(tag, TangentPlane(lens, tag)));
  }
  return out;
}

std::vector<DetectedTag> refine_corners(ImageView<const std::uint8_t> grey,
                                        const std::vector<DetectedTag>& tags, int border_bits,
                                        const Camera& camera, const RefineOptions& options) {
  std::vector<DetectedTag> out;
  out.reserve(tags.size());
  for (const RefinedTag& refined : refine_tags(grey, tags, border_bits, camera, options))
    out.push_back(refined.tag);
  return out;
}

}  // namespace fastibl
