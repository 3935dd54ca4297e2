#include "fastibl/capture/place_layout.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "fastibl/capture/bright_spots.h"

namespace fastibl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Around the page, for blur and the pose's error, which grow with how far off a large page is seen:
// metres, and as a share of the page's longer side.
constexpr double kBoardMargin = 0.01, kBoardMarginShare = 1 / 30.0;
constexpr double kInside = 0.9;  // of a picture's half width and height: what lies within is whole
// Metres, and seconds less times' rounding: nearer and sooner there is nothing new to see.
constexpr double kStep = 0.02, kPause = 0.2 - 1e-6;
constexpr double kParallax = 0.2;  // of the irradiance, for a radian between centre and camera

// A share that may overflow, as for a camera 1e200 m away: then all of it.
double at_most_all(double share) { return share < 1 ? share : 1; }

}  // namespace

PlaceLayout::PlaceLayout(const CaptureOptions& options, const TileOutlines& outlines)
    : centre_(options.centre),
      find_surface_(!options.distance && !options.box),
      told_box_(options.box.has_value()),
      locate_lights_(options.locate_lights),
      surroundings_(outlines, {centre_, options.distance.value_or(kInfinity), options.box}),
      sweep_(centre_),
      tracks_(centre_) {
  if (!options.board) return;
  const glm::dvec2 page(options.board->width, options.board->height);
  page_ = 0.5 * page;
  masked_ = page_ + std::max(kBoardMargin, kBoardMarginShare * std::max(page.x, page.y));
}

bool PlaceLayout::on_page(const glm::dvec2& point) const {
  return std::abs(point.x) <= page_.x && std::abs(point.y) <= page_.y;
}

std::optional<MapSurface> PlaceLayout::find_surface(const PosedPicture& posed) {
  if (!find_surface_ || !sweep_.wants_more()) return std::nullopt;
  const CameraSide& side = posed.side;
  sweep_.add(
      posed.pixels(), side.camera, side.lens, posed.poses,
      [&](float x, float y) { return side.vignette(x, y); }, posed.mask);
  return sweep_.better_than(surface());
}

Surroundings PlaceLayout::move_to(const MapSurface& surface, const TileOutlines& outlines) {
  Surroundings before = std::exchange(surroundings_, Surroundings(outlines, surface));
  surroundings_.place(outlines, before.lights());
  return before;
}

std::vector<int> PlaceLayout::locate_lights(const PosedPicture& posed, const TileOutlines& outlines,
                                            double exposure, double bright, double time) {
  CameraSide& side = posed.side;
  const Pose half = posed.half();
  const glm::dvec3 eye = half.inverse().translation;
  if (glm::length(eye - side.looked_from) < kStep && time - side.looked_at < kPause) return {};
  const Camera& camera = side.camera;
  std::optional<std::vector<BrightSpot>> spots;
  if (locate_lights_) {
    spots = find_bright_spots(posed.pixels(), camera, side.lens, posed.poses, exposure, bright,
                              posed.hidden);
    if (!spots) return {};
  }
  side.looked_from = eye, side.looked_at = time;
  far_ += glm::length(eye - centre_), ++looks_;
  if (!spots) return {};  // near things are in doubt anyway
  tracks_.add(eye, *spots, [&](const glm::dvec3& direction) {
    const auto pixel = side.lens.project(half.rotation * direction);
    return pixel && std::abs(2 * pixel->x / camera.width - 1) < kInside &&
           std::abs(2 * pixel->y / camera.height - 1) < kInside;
  });
  return surroundings_.place(outlines, tracks_.positions());
}

void PlaceLayout::turn(const glm::dmat3& new_from_old, const TileOutlines& outlines) {
  sweep_ = SphereSweep(centre_);
  tracks_ = LightTracks(centre_);
  std::optional<RoomBox> box = surface().box();
  if (box) box = turned(*box, new_from_old);
  surroundings_ = Surroundings(outlines, {centre_, surface().distance(), box});
}

// Where lights are near, what surrounds them usually is, too. Before the place of any light is
// known, what was seen of them tells a part, and the rest is doubt.
PlaceLayout::Parallax PlaceLayout::parallax() const {
  if (looks_ == 0) return {};
  const double by_gap = kParallax * far_ / looks_;  // gap: 1 / m
  const std::vector<LightPosition>& lights = surroundings_.lights();
  if (lights.empty()) {
    const LightTracks::Nearness near = tracks_.nearness(surface(), told_box_);
    const double all = at_most_all(by_gap * std::abs(near.gap));
    const double seen = at_most_all(near.seen);
    return {seen * all, (1 - seen) * all};
  }
  double gap = 0;
  for (const LightPosition& light : lights) gap += surroundings_.gap(light);
  return {at_most_all(by_gap * gap / double(lights.size())), 0};
}

}  // namespace fastibl
