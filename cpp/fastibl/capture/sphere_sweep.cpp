#include "fastibl/capture/sphere_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "fastibl/capture/fit_room.h"
#include "fastibl/capture/texel_state.h"

namespace fastibl {
namespace {

constexpr int kLongEdge = 48;    // pixels of a small picture
constexpr int kLargest = 4;      // pixels along an edge of what is read for one of them, if so many
constexpr float kDark = 0.012f;  // sum of linear RGB: 13 of 255
constexpr double kSky = 0.02;    // least z of a direction that counts as above the horizon
constexpr std::size_t kViews = 16;
constexpr double kBaseline = 0.04;  // metres between eyes; below, errors of the poses show
// Metres, and cosine between axes: a view that is nearer to an earlier one tells nothing new.
constexpr double kNewPlace = 0.03, kNewAxis = 0.985;
constexpr double kOverlap = 0.8;  // cosine between axes
// Views that are farther apart tell more of near things, up to here (metres), and those that look
// the same way share more: the product of both counts. kNoOverlap: cosine that is worth nothing.
constexpr double kWideBaseline = 0.25, kNoOverlap = 0.6;
constexpr std::size_t kNearWalls = 9;  // of kSwept: to be seen in both views as near as this, too
constexpr std::size_t kLeastPixels = 100;  // that two views share
constexpr float kOtherThing = 0.2f;   // difference of ln: not the same thing, or it has changed
constexpr double kPixelsAtOnce = 20;  // neighbouring pixels err alike: one in so many counts
constexpr double kLogOdds = 8, kLogOddsAgain = 2;  // for leaving infinity, and for other changes
constexpr double kFarAway = 1e9;                   // metres
constexpr double kInside = 1.2;  // from the centre, as a share of the camera's distance
// What is worth a change: a share of the inverse distance; and, from infinity, 1 / metres.
constexpr double kShare = 0.15, kLeast = 0.1;
// Walls: odds for moving them again, and how far they must move on the whole, 1 / metres.
constexpr double kLogOddsRoomAgain = 4, kMovedWalls = 0.01;
constexpr int kPairsPerFit = 4,
              kPairsPerSearch = 16;  // of views: around the present walls, and of all rooms
constexpr auto& kSwept = SweptCosts::kSwept;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

}  // namespace

float SphereSweep::View::at(const glm::dvec3& point) const {
  auto pixel = lens.project(half * point);
  if (pixel && poses.rolling()) pixel = lens.project(poses.at(pixel->y / height) * point);
  if (!pixel) return kNone;
  const double x = pixel->x / step - 0.5, y = pixel->y / step - 0.5;
  if (!(x >= 0 && y >= 0 && x < brightness.width - 1 && y < brightness.height - 1)) return kNone;
  const int left = int(x), top = int(y);
  const float across = float(x - left), down = float(y - top);
  const float *upper = brightness.pixel(left, top), *lower = brightness.pixel(left, top + 1);
  return (1 - down) * (upper[0] + across * (upper[1] - upper[0])) +
         down * (lower[0] + across * (lower[1] - lower[0]));
}

SphereSweep::View SphereSweep::small_view(const PixelReader& pixels, const Camera& camera,
                                          const Lens& lens, const RowPoses& poses,
                                          const Vignette& vignette,
                                          ImageView<const std::uint8_t> mask) {
  const int step = std::max(1, std::max(camera.width, camera.height) / kLongEdge);
  const Pose half = poses.at(0.5), back = half.inverse();
  View view{poses,
            half,
            lens,
            back.translation,
            back.rotation[2],
            step,
            camera.height,
            Image<float>(camera.width / step, camera.height / step, 1, kNone),
            {}};
  const int skip = std::max(1, step / kLargest);
  for (int row = 0; row < view.brightness.height; ++row) {
    const double y = (row + 0.5) * step;
    const glm::dmat3 turn = poses.at(y / camera.height).inverse().rotation;
    for (int column = 0; column < view.brightness.width; ++column) {
      const double x = (column + 0.5) * step;
      const auto ray = lens.unproject({x, y});
      view.rays.push_back(ray ? glm::vec3(glm::normalize(turn * *ray)) : glm::vec3(0));
      if (!ray || (!mask.empty() && !*mask.pixel(int(x), int(y)))) continue;
      const PixelReader::Block block = pixels.block(column * step, row * step, step, skip);
      const float sum = block.linear.x + block.linear.y + block.linear.z;
      const float light = sum / float(vignette(float(x), float(y)));
      if (block.clipped || !(sum > kDark && light > 0 && std::isfinite(light))) continue;
      *view.brightness.pixel(column, row) = std::log(light);
    }
  }
  return view;
}

void SphereSweep::add(const PixelReader& pixels, const Camera& camera, const Lens& lens,
                      const RowPoses& poses, const Vignette& vignette,
                      ImageView<const std::uint8_t> mask) {
  const Pose back = poses.at(0.5).inverse();
  const View* best = nullptr;
  double most = 0;
  for (const View& earlier : views_) {
    const double moved = glm::length(back.translation - earlier.eye);
    const double overlap = glm::dot(back.rotation[2], earlier.axis);
    if (moved < kNewPlace && overlap > kNewAxis) return;
    const double score = std::min(moved, kWideBaseline) * (overlap - kNoOverlap);
    if (moved >= kBaseline && overlap > kOverlap && score > most) best = &earlier, most = score;
  }
  View view = small_view(pixels, camera, lens, poses, vignette, mask);
  if (best) compare(view, *best);
  if (!wants_more()) return std::vector<View>().swap(views_);
  if (views_.size() == kViews) views_.erase(views_.begin());
  views_.push_back(std::move(view));
}

void SphereSweep::compare(const View& view, const View& earlier) {
  const glm::dvec3 offset = view.eye - centre_;
  const double farthest = std::max(glm::length(offset), glm::length(earlier.eye - centre_));
  // Spheres that hold both cameras.
  std::size_t count = kSwept.size();
  while (count > 1 && kInside * kSwept[count - 1] * farthest > 1) --count;
  struct Pixel {
    double along, square;
    glm::dvec3 ray;
    std::array<float, kSwept.size()> differences;
  };
  const auto reach = [](const Pixel& p, std::size_t k) {
    const double radius = kSwept[k] > 0 ? 1 / kSwept[k] : kFarAway;
    return std::sqrt(radius * radius - p.square) - p.along;
  };
  // Where the point is seen from the centre, not of unit length.
  const auto direction = [&](const Pixel& p, std::size_t k) {
    return kSwept[k] > 0 ? offset + reach(p, k) * p.ray : p.ray;
  };
  const std::size_t usual = std::min(SweptCosts::kUsual, count - 1),
                    near = std::min(kNearWalls, count - 1);
  std::vector<Pixel> pixels;
  for (std::size_t i = 0; i < view.rays.size(); ++i) {
    const float here = view.brightness.data[i];
    Pixel p{0, 0, glm::dvec3(view.rays[i]), {}};
    if (!(p.ray.z > kSky) || std::isnan(here)) continue;
    p.along = glm::dot(p.ray, offset), p.square = glm::dot(offset, offset) - p.along * p.along;
    if (costs_.enough(direction(p, usual))) continue;
    p.differences.fill(kNone);
    const auto look = [&](std::size_t k) {
      p.differences[k] = here - earlier.at(view.eye + reach(p, k) * p.ray);
      return !std::isnan(p.differences[k]);
    };
    if (!look(0) || !look(near)) continue;
    for (std::size_t k = 1; k < count; ++k)
      if (k != near) look(k);
    pixels.push_back(p);
  }
  if (pixels.size() < kLeastPixels) return;
  std::vector<float> present;
  for (std::size_t k = 0; k < count; ++k) {
    present.clear();
    for (const Pixel& p : pixels)
      if (!std::isnan(p.differences[k])) present.push_back(p.differences[k]);
    if (present.empty()) continue;
    // The exposures may be wrong: only what differs from pixel to pixel counts.
    const auto middle = present.begin() + std::ptrdiff_t(present.size() / 2);
    std::nth_element(present.begin(), middle, present.end());
    for (const Pixel& p : pixels) {
      if (std::isnan(p.differences[k])) continue;
      const float by = std::min(std::abs(p.differences[k] - *middle), kOtherThing);
      costs_.add(k, direction(p, k), double(by * by));
    }
  }
  compared_ += std::int64_t(pixels.size()), ++comparisons_, news_ = true;
}

// As if the differences were normal, of the deviation that the lower cost leaves and that of any
// two samples.
double SphereSweep::odds(double cost, double assumed) const {
  const double noise = 2 * double(kModelNoise * kModelNoise) * double(compared_);
  return 0.5 * double(compared_) / kPixelsAtOnce * std::log((assumed + noise) / (cost + noise));
}

std::optional<double> SphereSweep::better_distance(const Parts& parts, double assumed) const {
  std::array<double, kSwept.size()> costs{};
  for (const SweptCosts::Part& part : parts)
    for (std::size_t k = 0; k < kSwept.size(); ++k) costs[k] += part.cost[k];
  const std::size_t best =
      std::size_t(std::min_element(costs.begin(), costs.end()) - costs.begin());
  double inverse = kSwept[best];
  if (best > 0 && best + 1 < costs.size()) {  // the least of a parabola
    const double left = kSwept[best] - kSwept[best - 1], right = kSwept[best + 1] - kSwept[best];
    const double fall = (costs[best - 1] - costs[best]) / left;
    const double rise = (costs[best + 1] - costs[best]) / right;
    if (fall + rise > 0) inverse += 0.5 * (fall * right - rise * left) / (fall + rise);
  }
  if (!(std::abs(inverse - assumed) > (assumed > 0 ? kShare * assumed : kLeast))) return {};
  double cost = 0;
  for (const SweptCosts::Part& part : parts) cost += part.at(assumed);
  return odds(costs[best], cost) > (assumed > 0 ? kLogOddsAgain : kLogOdds) ? std::optional(inverse)
                                                                            : std::nullopt;
}

std::optional<RoomBox> SphereSweep::better_room(const Parts& parts,
                                                const MapSurface& assumed) const {
  const bool again = assumed.box().has_value();
  const RoomBox box = fit_room(parts, centre_, 1 / assumed.distance(), assumed.box(),
                               comparisons_ % kPairsPerSearch == 0);
  const MapSurface room(centre_, assumed.distance(), box);
  double cost = 0, before = 0, moved = 0, weight = 0;
  for (const SweptCosts::Part& part : parts) {
    const double now = room.nearness(part.direction), then = assumed.nearness(part.direction);
    cost += part.at(now), before += part.at(then);
    moved += part.weight * std::abs(now - then), weight += part.weight;
  }
  if (again && !(moved > kMovedWalls * weight)) return {};
  return odds(cost, before) > (again ? kLogOddsRoomAgain : kLogOdds) ? std::optional(box)
                                                                     : std::nullopt;
}

std::optional<MapSurface> SphereSweep::better_than(const MapSurface& assumed) {
  if (!std::exchange(news_, false)) return {};
  const bool fits = comparisons_ % kPairsPerFit == 0;
  if (assumed.box() && !fits) return {};
  const Parts parts = costs_.parts();
  const double inverse = 1 / assumed.distance();
  if (!assumed.box())
    if (const auto better = better_distance(parts, inverse))
      return MapSurface(centre_, 1 / *better, {});
  if (!(fits && inverse > kLeast)) return {};
  if (const auto better = better_room(parts, assumed))
    return MapSurface(centre_, assumed.distance(), better);
  return {};
}

}  // namespace fastibl
