#include "fastibl/capture/light_meter.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include "fastibl/scene/tag_codes.h"

namespace fastibl {
namespace {

constexpr int kAcross = 40;  // places along the longer side of the page
// Of the page's border, where it may curl, and where the picture of a large page, which is seen
// from farther off, mixes it with what lies beside it: metres, and as a share of the longer side.
constexpr double kMargin = 0.004, kMarginShare = 1 / 75.0;
constexpr double kLeastPixels = 2.5;     // from a place to the nearest ink: more than lens blur
constexpr std::size_t kLeastPlaces = 8;  // needed to tell an irradiance
constexpr int kBeside = 2;               // pixels from what is masked, which lens blur spreads
constexpr double kSteepest = 0.17;       // sine of the view above the plane: paper shines below

double distance_to_segment(const glm::dvec2& p, const glm::dvec2& a, const glm::dvec2& b) {
  const glm::dvec2 ab = b - a;
  const double t = std::clamp(glm::dot(p - a, ab) / glm::dot(ab, ab), 0.0, 1.0);
  return glm::length(p - (a + t * ab));
}

// Metres from a place to a tag's outline; negative inside.
double distance_to(const glm::dvec2& p, const Tag& tag) {
  double nearest = std::numeric_limits<double>::infinity();
  bool inside = true;
  for (std::size_t k = 0; k < 4; ++k) {
    const glm::dvec2 &a = tag.corners[k], &b = tag.corners[(k + 1) % 4];
    nearest = std::min(nearest, distance_to_segment(p, a, b));
    inside = inside && (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x) <= 0;  // clockwise
  }
  return inside ? -nearest : nearest;
}

}  // namespace

LightMeter::LightMeter(const Board& board, double albedo) : albedo_(albedo) {
  const double longer = std::max(board.width, board.height), step = longer / kAcross;
  const double margin = std::max(kMargin, kMarginShare * longer);
  const auto add = [&](glm::dvec2 at, double free, const Tag* within) {
    for (const Tag& tag : board.tags)
      if (&tag != within) free = std::min(free, distance_to(at, tag));
    if (free > 0) places_.push_back({at, free});
  };
  for (double y = margin - board.height / 2; y <= board.height / 2 - margin; y += step)
    for (double x = margin - board.width / 2; x <= board.width / 2 - margin; x += step)
      add({x, y}, std::numeric_limits<double>::infinity(), nullptr);
  // White modules of the tags, as large tags leave little paper around them.
  const int modules = kTagModules + 2 * board.border_bits;
  for (const Tag& tag : board.tags)
    for (int row = 0; row < kTagModules; ++row)
      for (int column = 0; column < kTagModules; ++column) {
        if (tag_module_black(tag.id, row, column)) continue;
        const double u = (column + board.border_bits + 0.5) / modules,
                     v = (row + board.border_bits + 0.5) / modules;
        const glm::dvec2 upper = glm::mix(tag.corners[0], tag.corners[1], u),
                         lower = glm::mix(tag.corners[3], tag.corners[2], u);
        add(glm::mix(upper, lower, v), 0.5 * glm::length(tag.corners[1] - tag.corners[0]) / modules,
            &tag);
      }
}

std::optional<glm::dvec3> LightMeter::read(const PixelReader& pixels, const Camera& camera,
                                           const Lens& lens, const Pose& camera_from_marker,
                                           double exposure, const PictureMask& hidden) const {
  const glm::dvec3 eye = camera_from_marker.inverse().translation;
  if (!(eye.z > kSteepest * glm::length(eye))) return std::nullopt;
  std::vector<float> values[3];
  std::size_t clipped = 0;  // of which only a bound is known
  for (const Place& place : places_) {
    const glm::dvec3 seen = camera_from_marker * glm::dvec3(place.at, 0);
    const auto pixel = lens.project(seen);
    if (!pixel) continue;
    if (!(pixel->x >= 1 && pixel->y >= 1 && pixel->x < camera.width - 1 &&
          pixel->y < camera.height - 1))
      continue;
    const int x = int(pixel->x), y = int(pixel->y);
    if (hidden.hides_any(x - kBeside, y - kBeside, x + kBeside + 1, y + kBeside + 1)) continue;
    // The plane is foreshortened most along the view.
    const double distance = glm::length(seen), sine = eye.z / distance;
    if (place.free * sine * std::min(camera.fx, camera.fy) / distance < kLeastPixels) continue;
    if (pixels.clipped(x, y)) {
      ++clipped;
      continue;
    }
    const double scale =
        std::numbers::pi / albedo_ / (exposure * camera.gain * camera.vignette({x + 0.5, y + 0.5}));
    const glm::vec3 linear = pixels.linear(x, y);
    for (int c = 0; c < 3; ++c) values[c].push_back(float(scale * double(linear[c])));
  }
  if (values[0].size() < kLeastPlaces || clipped > values[0].size()) return std::nullopt;
  glm::dvec3 out(0);
  for (int c = 0; c < 3; ++c) {
    const auto middle = values[c].begin() + std::ptrdiff_t(values[c].size() / 2);
    std::nth_element(values[c].begin(), middle, values[c].end());
    out[c] = double(*middle);
  }
  return out;
}

}  // namespace fastibl
