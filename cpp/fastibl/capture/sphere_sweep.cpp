#include "fastibl/capture/sphere_sweep.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

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
constexpr double kOverlap = 0.8;      // cosine between axes
constexpr int kLeastPixels = 100;     // that two views share
constexpr float kOtherThing = 0.2f;   // difference of ln: not the same thing, or it has changed
constexpr double kPixelsAtOnce = 20;  // neighbouring pixels err alike: one in so many counts
constexpr double kLogOdds = 8, kLogOddsAgain = 2;  // for leaving infinity, and for other changes
constexpr double kFarAway = 1e9;                   // metres
constexpr double kInside = 1.2;  // from the centre, as a share of the camera's distance
// What is worth a change: a share of the inverse distance; and, from infinity, 1 / metres.
constexpr double kShare = 0.15, kLeast = 0.1;

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
  double most = kOverlap;
  for (const View& earlier : views_) {
    const double moved = glm::length(back.translation - earlier.eye);
    const double overlap = glm::dot(back.rotation[2], earlier.axis);
    if (moved < kNewPlace && overlap > kNewAxis) return;
    if (moved >= kBaseline && overlap > most) best = &earlier, most = overlap;
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
  std::vector<float> differences[kSwept.size()];
  std::array<float, kSwept.size()> all;
  for (std::size_t i = 0; i < view.rays.size(); ++i) {
    const glm::dvec3 ray(view.rays[i]);
    const float here = view.brightness.data[i];
    if (!(ray.z > kSky) || std::isnan(here)) continue;
    const double along = glm::dot(ray, offset), square = glm::dot(offset, offset) - along * along;
    std::size_t k = 0;
    for (; k < count; ++k) {
      const double radius = kSwept[k] > 0 ? 1 / kSwept[k] : kFarAway;
      const double reach = std::sqrt(radius * radius - square) - along;
      all[k] = here - earlier.at(view.eye + reach * ray);
      if (std::isnan(all[k])) break;
    }
    if (k < count) continue;
    for (k = 0; k < count; ++k) differences[k].push_back(all[k]);
  }
  const std::size_t pixels = differences[0].size();
  if (pixels < kLeastPixels) return;
  for (std::size_t k = 0; k < count; ++k) {
    // The exposures may be wrong: only what differs from pixel to pixel counts.
    std::vector<float>& d = differences[k];
    std::nth_element(d.begin(), d.begin() + std::ptrdiff_t(pixels / 2), d.end());
    const float middle = d[pixels / 2];
    for (const float x : d) {
      const float by = std::min(std::abs(x - middle), kOtherThing);
      costs_[k] += double(by * by);
    }
  }
  for (std::size_t k = count; k < kSwept.size(); ++k)
    costs_[k] += double(kOtherThing * kOtherThing) * double(pixels);
  compared_ += std::int64_t(pixels);
}

std::optional<double> SphereSweep::better_than(double assumed) const {
  const std::size_t best =
      std::size_t(std::min_element(costs_.begin(), costs_.end()) - costs_.begin());
  if (compared_ == 0) return {};
  double inverse = kSwept[best];
  if (best > 0 && best + 1 < costs_.size()) {  // the least of a parabola
    const double left = kSwept[best] - kSwept[best - 1], right = kSwept[best + 1] - kSwept[best];
    const double fall = (costs_[best - 1] - costs_[best]) / left;
    const double rise = (costs_[best + 1] - costs_[best]) / right;
    if (fall + rise > 0) inverse += 0.5 * (fall * right - rise * left) / (fall + rise);
  }
  if (!(std::abs(inverse - assumed) > (assumed > 0 ? kShare * assumed : kLeast))) return {};
  const auto above = std::upper_bound(kSwept.begin() + 1, kSwept.end() - 1, assumed);
  const std::size_t k = std::size_t(above - kSwept.begin());
  const double part = (assumed - kSwept[k - 1]) / (kSwept[k] - kSwept[k - 1]);
  const double cost = costs_[k - 1] + part * (costs_[k] - costs_[k - 1]);
  // As if the differences were normal, of the deviation that the best distance leaves and that of
  // any two samples.
  const double noise = 2 * double(kModelNoise * kModelNoise) * double(compared_);
  const double odds =
      0.5 * double(compared_) / kPixelsAtOnce * std::log((cost + noise) / (costs_[best] + noise));
  return odds > (assumed > 0 ? kLogOddsAgain : kLogOdds) ? std::optional(inverse) : std::nullopt;
}

}  // namespace fastibl
