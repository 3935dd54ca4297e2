#include "fastibl/tracking/tracker.h"

#include <algorithm>
#include <cmath>

#include "fastibl/tracking/fit.h"

namespace fastibl {
namespace {

constexpr std::size_t kMostStarts = 8;   // largest tags whose own pose is tried as a start
constexpr double kSmallestNoise = 0.02;  // px; corners closer than this are not told apart
constexpr double kAmbiguous = 0.5;       // ratio of costs, see tests/test_tracking.py
constexpr double kSameMinimum =
    0.5 * std::numbers::pi / 180;  // choosing wrong costs less than this

struct Seen {
  DetectedTag tag;
  std::array<Match, 4> matches;
  double side = 0;  // px, mean
};

double side_px(const DetectedTag& tag) {
  double sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += glm::length(tag.corners[(i + 1) % 4] - tag.corners[i]);
  return sum / 4;
}

// Tags of the board that were seen once, largest first.
std::vector<Seen> seen_tags(const std::vector<DetectedTag>& tags, const Board& board) {
  std::vector<Seen> seen;
  for (const DetectedTag& tag : tags) {
    const Tag* on_board = board.find(tag.id);
    const auto same = [&](const DetectedTag& other) { return other.id == tag.id; };
    if (!on_board || std::count_if(tags.begin(), tags.end(), same) != 1) continue;
    Seen s{tag, {}, side_px(tag)};
    if (!std::isfinite(s.side) || !(s.side > 1)) continue;
    for (std::size_t i = 0; i < 4; ++i) s.matches[i] = {on_board->corners[i], tag.corners[i]};
    seen.push_back(s);
  }
  std::stable_sort(seen.begin(), seen.end(),
                   [](const Seen& a, const Seen& b) { return a.side > b.side; });
  return seen;
}

std::vector<Match> all_matches(const std::vector<Seen>& seen) {
  std::vector<Match> matches;
  for (const Seen& s : seen) matches.insert(matches.end(), s.matches.begin(), s.matches.end());
  return matches;
}

glm::dvec2 centre_of(std::span<const Match> matches) {
  glm::dvec2 sum(0);
  for (const Match& m : matches) sum += m.point;
  return sum / double(matches.size());
}

double squared_error(const Seen& s, const Lens& lens, const Pose& pose) {
  double sum = 0;
  for (const Match& m : s.matches) sum += std::pow(error_px(m, lens, pose), 2);
  return sum / 4;
}

// A tag more than half a side off speaks for nothing, however far off it is.
double disagreement(const std::vector<Seen>& seen, const Lens& lens, const Pose& pose) {
  double sum = 0;
  for (const Seen& s : seen)
    sum += std::min(0.25, squared_error(s, lens, pose) / (s.side * s.side));
  return sum;
}

// Pose that most tags agree with, among the detector's, all tags' homography, each large tag's own,
// and the mirror images of these.
std::optional<Pose> best_start(const std::vector<Seen>& seen, const Lens& lens,
                               const std::optional<Pose>& given) {
  std::optional<Pose> best;
  double least = 0;
  const auto consider = [&](const std::optional<Pose>& pose, const glm::dvec2& centre) {
    if (!pose) return;
    for (const Pose& candidate : {*pose, mirrored_pose(*pose, centre)}) {
      const double value = disagreement(seen, lens, candidate);
      if (std::isfinite(value) && (!best || value < least)) best = candidate, least = value;
    }
  };
  const std::vector<Match> matches = all_matches(seen);
  consider(given, centre_of(matches));
  if (seen.size() > 1) consider(pose_from_homography(matches, lens), centre_of(matches));
  for (std::size_t i = 0; i < std::min(seen.size(), kMostStarts); ++i)
    consider(pose_from_homography(seen[i].matches, lens), centre_of(seen[i].matches));
  return best;
}

// Standard deviation of a corner in x or y, from the median distance (of a 2-D normal distribution:
// 1.1774 σ); the six fitted parameters take up a share of the errors.
double noise_of(std::span<const Match> matches, const Lens& lens, const Pose& pose) {
  std::vector<double> errors;
  errors.reserve(matches.size());
  for (const Match& m : matches) errors.push_back(error_px(m, lens, pose));
  const auto middle = errors.begin() + std::ptrdiff_t(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  const double n = 2 * double(errors.size());
  return std::max(kSmallestNoise, *middle / 1.1774 * std::sqrt(n / std::max(2.0, n - 6)));
}

// Refines a pose and its mirror image, and keeps the cheaper one.
struct TwoMinima {
  std::optional<PoseFit> best, other;
};
TwoMinima fit_both(std::span<const Match> matches, const Lens& lens, const Pose& start,
                   const Loss& loss) {
  TwoMinima two{fit_pose(matches, lens, start, loss), std::nullopt};
  if (!two.best) return two;
  const Pose mirrored = mirrored_pose(two.best->camera_from_marker, centre_of(matches));
  two.other = fit_pose(matches, lens, mirrored, loss);
  if (two.other && two.other->cost < two.best->cost) std::swap(two.best, two.other);
  return two;
}

// Seen from its printed side, and in front of the camera.
bool possible(const Pose& camera_from_marker, std::span<const Match> matches) {
  for (const Match& m : matches)
    if (!((camera_from_marker * glm::dvec3(m.point, 0)).z > 0)) return false;
  return camera_from_marker.inverse().translation.z > 0;
}

bool invert(const std::array<double, 36>& a, std::array<double, 36>& inverse) {
  for (std::size_t c = 0; c < 6; ++c) {
    std::array<double, 6> unit{}, x{};
    unit[c] = 1;
    if (!solve6(a, unit, x)) return false;
    for (std::size_t r = 0; r < 6; ++r) inverse[6 * r + c] = x[r];
  }
  return true;
}

// Tags whose corners fit within the loss. With few tags nothing tells which one is wrong: all stay.
std::vector<Seen> agreeing(const std::vector<Seen>& seen, const Lens& lens, const Pose& pose,
                           double limit) {
  std::vector<Seen> kept;
  for (const Seen& s : seen)
    if (std::sqrt(squared_error(s, lens, pose)) < limit) kept.push_back(s);
  return kept;
}

}  // namespace

std::optional<Tracked> track(const Detection& detection, const Board& board, const Camera& camera,
                             const TrackingOptions& options) {
  const Lens lens(camera);
  std::vector<Seen> seen = seen_tags(detection.tags, board);
  if (options.method == TrackingMethod::frame_marker && seen.size() > 1) seen.resize(1);
  if (seen.empty()) return std::nullopt;
  const std::optional<Pose> start = best_start(seen, lens, detection.start);
  if (!start) return std::nullopt;

  const std::vector<Match> matches = all_matches(seen);
  TwoMinima fit = fit_both(matches, lens, *start, {Loss::Kind::huber, 1.0});
  if (!fit.best) return std::nullopt;
  const auto limit = [&](double noise) { return std::max(0.25, 5 * noise); };
  std::vector<Seen> used = seen;
  if (seen.size() > 2) {
    // Twice: the first scale is still that of a fit which outliers pull at.
    for (int round = 0; round < 2; ++round) {
      const Pose pose = fit.best->camera_from_marker;
      const Loss loss{Loss::Kind::tukey, limit(noise_of(matches, lens, pose))};
      if (const auto next = fit_pose(matches, lens, pose, loss)) fit.best = next;
    }
    const Pose pose = fit.best->camera_from_marker;
    used = agreeing(seen, lens, pose, limit(noise_of(matches, lens, pose)));
    // Wrong ids: a pose that one or two tags of many agree on is theirs, not the board's.
    if (used.size() < 3 && 2 * used.size() <= seen.size()) return std::nullopt;
    if (3 * used.size() < seen.size()) return std::nullopt;
  }

  // The last word between the two minima, on the tags that count.
  const std::vector<Match> good = all_matches(used);
  const Loss loss{
      Loss::Kind::huber,
      3 * std::max(options.noise_px, noise_of(good, lens, fit.best->camera_from_marker))};
  fit = fit_both(good, lens, fit.best->camera_from_marker, loss);
  if (!fit.best || !possible(fit.best->camera_from_marker, good)) return std::nullopt;

  Tracked tracked;
  tracked.camera_from_marker = fit.best->camera_from_marker;
  double squares = 0, largest = 0;
  for (const Seen& s : used) {
    squares += squared_error(s, lens, tracked.camera_from_marker);
    largest = std::max(largest, s.side);
    tracked.tags.push_back(s.tag);
  }
  tracked.residual_px = std::sqrt(squares / double(used.size()));
  if (!(tracked.residual_px <= options.largest_residual_px + 0.03 * largest)) return std::nullopt;

  const double floor = double(2 * good.size()) * options.noise_px * options.noise_px;
  if (fit.other && possible(fit.other->camera_from_marker, good) &&
      rotation_angle(fit.other->camera_from_marker.rotation, tracked.camera_from_marker.rotation) >
          kSameMinimum)
    tracked.ambiguity = (fit.best->cost + floor) / (fit.other->cost + floor);
  tracked.ambiguous = tracked.ambiguity > kAmbiguous;

  if (!invert(fit.best->information, tracked.covariance)) return std::nullopt;
  // Residuals of a single tag are 8 numbers for 6 parameters: the expected noise is the floor.
  const double variance = std::max(options.noise_px * options.noise_px,
                                   fit.best->cost / std::max(2.0, 2.0 * double(good.size()) - 6));
  for (double& c : tracked.covariance) c *= variance;
  return tracked;
}

std::optional<Tracked> track(const Detector& detector, ImageView<const std::uint8_t> grey,
                             const Board& board, const Camera& camera,
                             const TrackingOptions& options) {
  check(grey.channels == 1 && grey.width == camera.width && grey.height == camera.height,
        "track needs a grey picture of the camera's size ", camera.width, " × ", camera.height,
        ", got ", grey.width, " × ", grey.height, " with ", grey.channels, " channels");
  Detection detection = detector(grey, board, camera);
  if (options.refine)
    detection.tags =
        refine_corners(grey, detection.tags, board.border_bits, camera, options.refining);
  return track(detection, board, camera, options);
}

}  // namespace fastibl
