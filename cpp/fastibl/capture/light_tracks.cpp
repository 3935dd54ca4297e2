#include "fastibl/capture/light_tracks.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace fastibl {
namespace {

constexpr std::size_t kSightings = 48, kTracks = 64;  // kept
constexpr double kSamePlace = 0.02;  // metres between eyes; below, nothing new to triangulate from
constexpr double kPose = 0.004;      // radians: of the pose and of the middle of a small spot
constexpr double kShape = 0.05;      // of the angular radius: its outline changes with the view
constexpr double kLikely = 0.3, kSpread = 0.5;  // 1 / m: ρ before anything is known of it
constexpr double kBeforeWalls = 0.5;            // of that, where walls were found
constexpr double kNearest = 5;                  // 1 / m
constexpr double kGate = 16;  // squared standard deviations of a sighting from its track
constexpr double kSizes = 4;  // ratio of a sighting's solid angle to the last one's
constexpr int kMissed = 6;    // pictures in a row that should show a light and do not
constexpr std::size_t kLeastSightings = 4;
constexpr double kKnown = 0.2;  // relative standard deviation of a distance that is known
constexpr double kHuber = 2;    // standard deviations
constexpr int kRounds = 4;

double noise_of(double solid_angle) { return std::hypot(kPose, kShape * disc_radius(solid_angle)); }

// Columns: two axes across v, and v itself, which has unit length.
glm::dmat3 frame_of(const glm::dvec3& v) {
  const glm::dvec3 other = std::abs(v.z) < 0.7 ? glm::dvec3(0, 0, 1) : glm::dvec3(1, 0, 0);
  const glm::dvec3 first = glm::normalize(glm::cross(other, v));
  return {first, glm::cross(v, first), v};
}

// Difference of two directions across the first, and its derivative with respect to a, b and ρ.
struct Misfit {
  glm::dvec2 residual;
  glm::dmat3x2 derivative;
};

Misfit misfit(const glm::dvec3& seen, const glm::dmat3& frame, const glm::dvec3& towards,
              const glm::dvec3& offset, double inverse_distance) {
  const glm::dvec3 w = towards - inverse_distance * offset;
  const double length = glm::length(w);
  const glm::dvec3 u = w / length;
  const glm::dmat3 across = frame_of(seen);
  const auto turn = [&](const glm::dvec3& by) {
    const glm::dvec3 change = (by - u * glm::dot(u, by)) / length;
    return glm::dvec2(glm::dot(across[0], change), glm::dot(across[1], change));
  };
  return {{glm::dot(across[0], u), glm::dot(across[1], u)},
          {turn(frame[0]), turn(frame[1]), turn(-offset)}};
}

}  // namespace

glm::dvec3 LightTracks::predicted(const Track& track, const glm::dvec3& eye) const {
  return glm::normalize(track.v - track.inverse_distance * (eye - centre_));
}

void LightTracks::fit(Track& track) const {
  track.frame = frame_of(track.v);
  const double noise = noise_of(track.solid_angle);
  glm::dvec3 parameters{0, 0, track.inverse_distance};
  glm::dmat3 normal(0.0);
  double squares = 0;
  for (int round = 0; round < kRounds; ++round) {
    normal = glm::dmat3(0.0);
    glm::dvec3 gradient(0.0);
    squares = 0;
    const glm::dvec3 towards =
        track.frame[2] + parameters.x * track.frame[0] + parameters.y * track.frame[1];
    for (const Sight& s : track.sightings) {
      const Misfit m = misfit(s.direction, track.frame, towards, s.eye - centre_, parameters.z);
      const double error = glm::length(m.residual) / noise;
      const double weight = (error > kHuber ? kHuber / error : 1.0) / (noise * noise);
      normal += weight * glm::transpose(m.derivative) * m.derivative;
      gradient += weight * glm::transpose(m.derivative) * m.residual;
      squares += glm::dot(m.residual, m.residual);
    }
    normal[2][2] += 1 / (kSpread * kSpread);
    gradient.z += (parameters.z - kLikely) / (kSpread * kSpread);
    parameters -= glm::inverse(normal) * gradient;
    parameters.z = std::clamp(parameters.z, 0.0, kNearest);
  }
  const double count = 2 * double(track.sightings.size());
  const double excess = std::max(1.0, squares / (noise * noise * std::max(count - 3, 1.0)));
  const glm::dvec3 v =
      track.frame[2] + parameters.x * track.frame[0] + parameters.y * track.frame[1];
  track.v = v / glm::length(v);
  track.inverse_distance = parameters.z / glm::length(v);
  track.covariance = glm::inverse(normal) * excess;
}

void LightTracks::follow(const glm::dvec3& eye, std::span<const BrightSpot> spots) {
  struct Pair {
    double distance;
    std::size_t track, spot;
  };
  std::vector<Pair> pairs;
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    Track& track = tracks_[t];
    track.matched = false;
    ++track.away;
    const double noise = noise_of(track.solid_angle);
    for (std::size_t s = 0; s < spots.size(); ++s) {
      const double ratio = spots[s].solid_angle / track.solid_angle;
      if (ratio > kSizes || ratio * kSizes < 1) continue;
      const Misfit m =
          misfit(spots[s].direction, track.frame, track.v, eye - centre_, track.inverse_distance);
      if (glm::dot(predicted(track, eye), spots[s].direction) < 0.8) continue;
      const glm::dmat2 spread = m.derivative * track.covariance * glm::transpose(m.derivative) +
                                glm::dmat2(2 * noise * noise);
      const double distance = glm::dot(m.residual, glm::inverse(spread) * m.residual);
      if (distance < kGate) pairs.push_back({distance, t, s});
    }
  }
  std::sort(pairs.begin(), pairs.end(),
            [](const Pair& a, const Pair& b) { return a.distance < b.distance; });
  std::vector<bool> taken(spots.size(), false);
  for (const Pair& pair : pairs) {
    Track& track = tracks_[pair.track];
    if (track.matched || taken[pair.spot]) continue;
    track.matched = true, taken[pair.spot] = true, track.missed = track.away = 0;
    const Sight sighting{eye, spots[pair.spot].direction};
    // Seen again from where it was seen before, what is wrong with a sighting is wrong again.
    std::erase_if(track.sightings,
                  [&](const Sight& s) { return glm::length(eye - s.eye) < kSamePlace; });
    track.sightings.push_back(sighting);
    if (track.sightings.size() > kSightings) track.sightings.erase(track.sightings.begin());
    track.solid_angle = spots[pair.spot].solid_angle;
    fit(track);
  }
  for (std::size_t s = 0; s < spots.size(); ++s) {
    if (taken[s]) continue;
    if (!make_room()) return;
    Track track;
    track.sightings.push_back({eye, spots[s].direction});
    track.solid_angle = spots[s].solid_angle;
    track.v = glm::normalize(kLikely * (eye - centre_) + spots[s].direction);
    track.inverse_distance = kLikely;
    track.matched = true;
    fit(track);
    tracks_.push_back(std::move(track));
  }
}

// Where the camera stays, no picture shows that what came and went beside it is gone. It gives way:
// first what was seen from too few places to be located, then what was seen longest ago.
bool LightTracks::make_room() {
  if (tracks_.size() < kTracks) return true;
  const auto worth = [](const Track& track) {
    return std::tuple(track.matched, track.sightings.size() >= kLeastSightings, -track.away);
  };
  const auto least =
      std::min_element(tracks_.begin(), tracks_.end(),
                       [&](const Track& a, const Track& b) { return worth(a) < worth(b); });
  if (least->matched) return false;
  tracks_.erase(least);
  return true;
}

void LightTracks::forget() {
  std::erase_if(tracks_, [](const Track& track) { return track.missed > kMissed; });
}

std::vector<LightPosition> LightTracks::positions() const {
  std::vector<LightPosition> out;
  for (const Track& track : tracks_) {
    const double deviation = std::sqrt(track.covariance[2][2]), rho = track.inverse_distance;
    if (track.sightings.size() < kLeastSightings || !(deviation < kKnown * rho)) continue;
    // Derivative of P = c + v / ρ: along the frame's axes, and back along v for ρ.
    const glm::dmat3 by{track.frame[0] / rho, track.frame[1] / rho, -track.v / (rho * rho)};
    const glm::dvec3 position = centre_ + track.v / rho;
    out.push_back({track.v, position, by * track.covariance * glm::transpose(by),
                   glm::length(position - track.sightings.back().eye) *
                       std::sin(std::min(disc_radius(track.solid_angle), 1.5))});
  }
  return out;
}

// Each track counts by how well it is known: one seen once says no more than what was likely
// before.
LightTracks::Nearness LightTracks::nearness(const MapSurface& usual, bool told) const {
  // Whoever tells a box knows that lights hang on its walls, unless they are seen elsewhere. Walls
  // that were found tell part of it: there may be things before them.
  const double doubted = told ? 0 : usual.box() ? kBeforeWalls : 1;
  double sum = doubted * (kLikely - usual.nearness({0, 0, 1})), weight = 1;
  for (const Track& track : tracks_) {
    const double own = kSpread * kSpread / track.covariance[2][2];
    sum += own * (track.inverse_distance - usual.nearness(track.v)), weight += own;
  }
  return {sum / weight, 1 - 1 / weight};
}

std::vector<LightTracks::Sight> LightTracks::sights(const LightPosition& light) const {
  for (const Track& track : tracks_)
    if (track.matched && track.v == light.direction) return track.sightings;
  return {};
}

}  // namespace fastibl
