// Near lights: where they are, and what the map knew of them while that was not known.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/capture/bright_spots.h"
#include "fastibl/capture/capture.h"

namespace fastibl {
namespace {

constexpr double kInside = 0.9;  // of a picture's half width and height: what lies within is whole
// Metres, and seconds less times' rounding: nearer and sooner there is nothing new to see.
constexpr double kStep = 0.02, kPause = 0.2 - 1e-6;
constexpr double kBlur = 0.03;     // radians around a light that it lights in the map
constexpr double kParallax = 0.2;  // of the irradiance, for a radian between centre and camera
constexpr double kOutline = 1.5;   // of a light's radius: a disc that holds it though it is no disc
constexpr double kPixelBlur = 2;

// A share that may overflow, as for a camera 1e200 m away: then all of it.
double at_most_all(double share) { return share < 1 ? share : 1; }

}  // namespace

double Capture::mean_radiance() const {
  double flux = 0, angle = 0;
  for (std::size_t i = 0; i < map_.sums.size(); ++i) {
    const glm::dvec3 seen = map_.sums[i].flux;
    angle += map_.sums[i].angle;
    flux += seen.x + seen.y + seen.z + filled_flux(i);
  }
  return angle > 0 ? flux / (3 * 4 * std::numbers::pi) : 0;  // 0, not the guess for unseen parts
}

void Capture::locate_lights(const PosedPicture& posed, double exposure) {
  CameraSide& side = posed.side;
  const Pose half = posed.half();
  const glm::dvec3 eye = half.inverse().translation;
  if (glm::length(eye - side.looked_from) < kStep && time_ - side.looked_at < kPause) return;
  const Camera& camera = side.camera;
  std::optional<std::vector<BrightSpot>> spots;
  if (options_.locate_lights) {
    spots = find_bright_spots(posed.pixels(), camera, side.lens, posed.poses, exposure, bright_);
    if (!spots) return;
  }
  side.looked_from = eye, side.looked_at = time_;
  far_ += glm::length(eye - options_.centre), ++looks_;
  if (!spots) return;  // near things are in doubt anyway
  tracks_.add(eye, *spots, [&](const glm::dvec3& direction) {
    const auto pixel = side.lens.project(half.rotation * direction);
    return pixel && std::abs(2 * pixel->x / camera.width - 1) < kInside &&
           std::abs(2 * pixel->y / camera.height - 1) < kInside;
  });
  const std::vector<LightPosition> lights = tracks_.positions();
  const std::vector<int> moved = surroundings_.place(map_.geometry.outlines, lights);
  if (moved.empty()) return;
  for (const LightPosition& light : lights) forget_light(light, moved);
}

// Where lights are near, what surrounds them usually is, too. Before the place of any light is
// known, what was seen of them tells a part, and the rest is doubt.
Capture::Parallax Capture::parallax() const {
  if (looks_ == 0) return {};
  const double by_gap = kParallax * far_ / looks_;  // gap: 1 / m
  const std::vector<LightPosition>& lights = surroundings_.lights();
  if (lights.empty()) {
    const LightTracks::Nearness near = tracks_.nearness(surface(), options_.box.has_value());
    const double all = at_most_all(by_gap * std::abs(near.gap));
    const double seen = at_most_all(near.seen);
    return {seen * all, (1 - seen) * all};
  }
  double gap = 0;
  for (const LightPosition& light : lights) gap += surroundings_.gap(light);
  return {at_most_all(by_gap * gap / double(lights.size())), 0};
}

// A near light hides what is far behind it, which other tiles than its own show.
void Capture::find_hidden(const PosedPicture& posed) {
  const CameraSide& side = posed.side;
  hidden_.clear();
  const Pose half = posed.half();
  for (const LightPosition& light : surroundings_.lights()) {
    glm::dvec3 seen = half * light.position;
    auto pixel = side.lens.project(seen);
    if (pixel && posed.poses.rolling()) {
      seen = posed.poses.at(pixel->y / side.camera.height) * light.position;
      pixel = side.lens.project(seen);
    }
    if (!pixel) continue;
    const double distance = glm::length(seen);
    // Towards the picture's border the same angle covers more pixels.
    const double slope = distance / seen.z, focal = std::max(side.camera.fx, side.camera.fy);
    const double radius = kOutline * light.radius / distance * focal * slope * slope + kPixelBlur;
    hidden_.push_back({float(pixel->x), float(pixel->y), float(radius * radius)});
  }
}

// Where the light was recorded while its place was unknown or wrong, the map shows it beside
// itself, and that part must be seen anew. Only a light that the picture shows is forgotten, as it
// is seen anew at once.
void Capture::forget_light(const LightPosition& light, const std::vector<int>& moved) {
  const std::vector<LightTracks::Sight> sights = tracks_.sights(light);
  if (sights.empty()) return;
  std::vector<glm::dvec3> ghosts;
  for (const LightTracks::Sight& sight : sights)
    ghosts.push_back(surroundings_.surface().recorded(sight.eye, sight.direction));
  const double radius = angular_radius(light, options_.centre);
  const std::uint64_t version = new_tile_version();
  for (int tile = 0; tile < map_.grid().count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    if (!map_.above(tile) || map_.sums[i].count == 0) continue;
    bool shows = std::find(moved.begin(), moved.end(), tile) != moved.end();
    if (!shows) {
      const glm::dvec3 middle = map_.geometry.outlines.middle(tile);
      const double reach = kOutline * radius + kBlur + map_.geometry.outlines.reach(tile);
      shows = std::any_of(ghosts.begin(), ghosts.end(), [&](const glm::dvec3& ghost) {
        return glm::dot(ghost, middle) > std::cos(reach);
      });
    }
    if (shows && forget_bright(tile)) map_.versions[i] = version;
  }
}

// Makes the tile's bright texels unseen; true if there are any.
bool Capture::forget_bright(int tile) {
  const FaceRect r = tile_rect(map_.grid(), tile);
  const std::size_t start = map_.geometry.start(tile);
  double* last_seen = nullptr;
  for (int k = 0; k < r.texels(); ++k) {
    const std::size_t at = start + std::size_t(k);
    const double sum = double(map_.state.value[0][at]) + double(map_.state.value[1][at]) +
                       double(map_.state.value[2][at]);
    if (!(sum > 3 * bright_) || !(map_.state.last_seen.at(tile, k) > kNever)) continue;
    if (!last_seen) last_seen = map_.state.last_seen.texels(tile);
    last_seen[k] = kNever;
    map_.state.bound[at] = 0;
    for (int c = 0; c < 3; ++c) map_.state.variance[c][at] = 0;
  }
  if (!last_seen) return false;
  map_.sum(tile);
  new_sums_.push_back(tile);
  refill(tile);
  return true;
}

}  // namespace fastibl
