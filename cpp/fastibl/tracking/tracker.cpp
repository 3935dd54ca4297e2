#include "fastibl/tracking/tracker.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "fastibl/core/check.h"
#include "fastibl/tracking/corner_covariance.h"
#include "fastibl/tracking/fit.h"
#include "fastibl/tracking/roll_corners.h"

namespace fastibl {
namespace {

constexpr std::size_t kMostStarts = 8;   // largest tags whose own pose is tried as a start
constexpr double kSmallestNoise = 0.02;  // px; corners closer than this are not told apart
constexpr double kUnmeasured = 8;        // noise of a detector's corner, relative to a measured one
constexpr double kRollingResidual = 4;   // px, at a degree or two in a readout
constexpr double kAmbiguous = 0.5;       // ratio of costs, see tests/test_tracking.py
constexpr double kSameMinimum = 0.5 * kDegree;  // choosing wrong costs less than this

// Of each detected tag, whether and how well its sides were measured; empty where none was.
using Measured = std::vector<std::optional<SideErrors>>;

struct Seen {
  DetectedTag tag;
  std::array<Match, 4> matches;
  double side = 0;  // px, mean
  std::optional<SideErrors> errors{};
};

double side_px(const DetectedTag& tag) {
  double sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += glm::length(tag.corners[(i + 1) % 4] - tag.corners[i]);
  return sum / 4;
}

// How often each tag of the board is seen: more than once, it is another board's too.
std::map<int, int> counts_of(const std::vector<DetectedTag>& tags, const Board& board) {
  std::map<int, int> counts;
  for (const DetectedTag& tag : tags)
    if (board.find(tag.id)) ++counts[tag.id];
  return counts;
}

// Tags of the board that were seen once, largest first.
std::vector<Seen> seen_tags(const std::vector<DetectedTag>& tags, const Measured& measured,
                            const Board& board, const std::map<int, int>& counts) {
  std::vector<Seen> seen;
  for (std::size_t k = 0; k < tags.size(); ++k) {
    const DetectedTag& tag = tags[k];
    const Tag* on_board = board.find(tag.id);
    if (!on_board || counts.at(tag.id) != 1) continue;
    Seen s{tag, {}, side_px(tag)};
    if (!std::isfinite(s.side) || !(s.side > 1)) continue;
    if (!measured.empty()) s.errors = measured[k];
    const double noise = measured.empty() || s.errors ? 1.0 : kUnmeasured;
    for (std::size_t i = 0; i < 4; ++i)
      s.matches[i] = {on_board->corners[i], tag.corners[i], noise};
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

// Mean over the corners, in units of the tag's noise.
double squared_error(const Seen& s, const Lens& lens, const Pose& pose) {
  double sum = 0;
  for (const Match& m : s.matches) sum += std::pow(error_of(m, lens, pose), 2);
  return sum / 4;
}

double squared_px(const Seen& s, const Lens& lens, const Pose& pose) {
  return squared_error(s, lens, pose) * s.matches[0].noise * s.matches[0].noise;
}

// From 0 to 1 for each tag, so that one far off weighs no more than another; but of two poses that
// are both far off, the nearer one is still less.
double disagreement(const std::vector<Seen>& seen, const Lens& lens, const Pose& pose) {
  double sum = 0;
  for (const Seen& s : seen) {
    const double error = std::min(1e6, squared_px(s, lens, pose) / (s.side * s.side));
    sum += error / (error + 0.05);
  }
  return sum;
}

// Seen from its printed side, and in front of the camera.
bool possible(const Pose& camera_from_marker, std::span<const Match> matches) {
  for (const Match& m : matches)
    if (!((camera_from_marker * glm::dvec3(m.point, 0)).z > 0)) return false;
  return camera_from_marker.inverse().translation.z > 0;
}

// Pose that most tags agree with, among the detector's, all tags' homography, each large tag's own,
// and the mirror images of these.
std::optional<Pose> best_start(const std::vector<Seen>& seen, const Lens& lens,
                               const std::optional<Pose>& given) {
  const std::vector<Match> matches = all_matches(seen);
  std::optional<Pose> best;
  double least = 0;
  const auto consider = [&](const std::optional<Pose>& pose, const glm::dvec2& centre) {
    if (!pose) return;
    for (const Pose& candidate : {*pose, mirrored_pose(*pose, centre)}) {
      if (!possible(candidate, matches)) continue;
      const double value = disagreement(seen, lens, candidate);
      if (std::isfinite(value) && (!best || value < least)) best = candidate, least = value;
    }
  };
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
  for (const Match& m : matches) errors.push_back(error_of(m, lens, pose));
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
  TwoMinima two;
  const auto consider = [&](const Pose& from) {
    auto fit = fit_pose(matches, lens, from, loss);
    // From the mirror image a fit may slide over the edge-on view to the back of the board.
    if (!fit || !possible(fit->camera_from_marker, matches)) return;
    if (!two.best || fit->cost < two.best->cost) std::swap(fit, two.best);
    if (fit && (!two.other || fit->cost < two.other->cost)) two.other = fit;
  };
  const glm::dvec2 centre = centre_of(matches);
  consider(start);
  consider(mirrored_pose(start, centre));
  if (two.best && !two.other) consider(mirrored_pose(two.best->camera_from_marker, centre));
  return two;
}

// Cost of the second minimum. Where noise has merged it with the first, it is that of the mirrored
// pose itself, because the truth may lie there. Nothing where that is the same pose.
std::optional<double> other_cost(const TwoMinima& fit, std::span<const Match> matches,
                                 const Lens& lens, const Loss& loss) {
  const Pose& best = fit.best->camera_from_marker;
  const auto differs = [&](const Pose& pose) {
    return possible(pose, matches) && rotation_angle(pose.rotation, best.rotation) > kSameMinimum;
  };
  if (fit.other && differs(fit.other->camera_from_marker)) return fit.other->cost;
  const Pose mirrored = mirrored_pose(best, centre_of(matches));
  if (!differs(mirrored)) return std::nullopt;
  double cost = 0;
  for (const Match& m : matches) cost += loss.cost(std::min(1e4, error_of(m, lens, mirrored)));
  return cost;
}

// The half of the tags that agree best on one pose near `pose`, which is moved there: least trimmed
// squares by concentration steps (Rousseeuw and Van Driessen 1999), unmoved by fewer than half
// wrong tags even when they all err to one side. All of one or two tags.
std::vector<Seen> better_half(std::vector<Seen> seen, const Lens& lens, Pose& pose) {
  if (seen.size() < 3) return seen;
  const std::vector<Seen> all = seen;
  for (int round = 0; round < 4; ++round) {
    seen = all;
    std::stable_sort(seen.begin(), seen.end(), [&](const Seen& a, const Seen& b) {
      return squared_px(a, lens, pose) < squared_px(b, lens, pose);
    });
    seen.resize(all.size() / 2 + 1);
    const auto fit = fit_pose(all_matches(seen), lens, pose, {Loss::Kind::huber, 1.0});
    if (!fit) break;
    pose = fit->camera_from_marker;
  }
  return seen;
}

// Tags whose corners fit within the limit, in units of their noise.
std::vector<Seen> agreeing(const std::vector<Seen>& seen, const Lens& lens, const Pose& pose,
                           double limit) {
  std::vector<Seen> kept;
  for (const Seen& s : seen)
    if (std::sqrt(squared_error(s, lens, pose)) < limit) kept.push_back(s);
  return kept;
}

// Where a pose puts a tag's corners; nothing unless it was seen close to there.
std::optional<DetectedTag> expected_tag(const DetectedTag& seen, const Board& board,
                                        const Lens& lens, const Pose& pose) {
  const Tag* on_board = board.find(seen.id);
  if (!on_board) return std::nullopt;
  DetectedTag tag{seen.id, {}};
  for (std::size_t i = 0; i < 4; ++i) {
    const auto pixel = lens.project(pose * glm::dvec3(on_board->corners[i], 0));
    if (!pixel || glm::length(*pixel - seen.corners[i]) > std::max(3.0, 0.1 * side_px(seen)))
      return std::nullopt;
    tag.corners[i] = *pixel;
  }
  return tag;
}

std::optional<Tracked> fit_still(const Detection& detection, const Measured& measured,
                                 const Board& board, const Camera& camera,
                                 const TrackingOptions& options) {
  const double expected = measured.empty() ? options.detected_noise_px : options.refined_noise_px;
  const Lens lens(camera);
  const std::map<int, int> counts = counts_of(detection.tags, board);
  std::vector<Seen> seen = seen_tags(detection.tags, measured, board, counts);
  const auto doubled = std::size_t(std::count_if(
      counts.begin(), counts.end(), [](const auto& counted) { return counted.second > 1; }));
  const bool by_one = options.method == TrackingMethod::frame_marker;
  if (doubled > (by_one ? 0 : seen.size())) return std::nullopt;  // two boards of the same print
  if (by_one && seen.size() > 1) seen.resize(1);
  if (seen.empty()) return std::nullopt;
  std::optional<Pose> start = best_start(seen, lens, detection.start);
  if (!start) return std::nullopt;

  const std::vector<Match> matches = all_matches(seen);
  const std::vector<Match> half = all_matches(better_half(seen, lens, *start));
  TwoMinima fit = fit_both(half, lens, *start, {Loss::Kind::huber, 1.0});
  if (!fit.best) return std::nullopt;
  const auto limit = [](double sigma) { return std::max(0.25, 5 * sigma); };
  std::vector<Seen> used = seen;
  if (seen.size() > 2) {
    // Twice: the first scale is that of a fit to half of the tags.
    for (int round = 0; round < 2; ++round) {
      const Pose pose = fit.best->camera_from_marker;
      const Loss loss{Loss::Kind::tukey, limit(noise_of(matches, lens, pose))};
      if (const auto next = fit_pose(matches, lens, pose, loss)) fit.best = next;
    }
    const Pose pose = fit.best->camera_from_marker;
    used = agreeing(seen, lens, pose, limit(noise_of(matches, lens, pose)));
    if (used.empty()) return std::nullopt;
  }

  // The last word between the two minima, on the tags that count.
  const std::vector<Match> good = all_matches(used);
  const Loss loss{Loss::Kind::huber,
                  3 * std::max(expected, noise_of(good, lens, fit.best->camera_from_marker))};
  fit = fit_both(good, lens, fit.best->camera_from_marker, loss);
  if (!fit.best) return std::nullopt;

  Tracked tracked;
  tracked.camera_from_marker = fit.best->camera_from_marker;
  double squares = 0, largest = 0;
  for (const Seen& s : used) {
    squares += squared_px(s, lens, tracked.camera_from_marker);
    largest = std::max(largest, s.side);
    tracked.tags.push_back(s.tag);
  }
  tracked.residual_px = std::sqrt(squares / double(used.size()));
  // Wrong ids: tags without a common pose leave a compromise that fits none of them.
  if (!(tracked.residual_px <= options.largest_residual_px + 0.02 * largest)) return std::nullopt;

  const double floor = double(2 * good.size()) * expected * expected;
  if (const auto other = other_cost(fit, good, lens, loss))
    tracked.ambiguity = std::min(1.0, (fit.best->cost + floor) / (*other + floor));
  tracked.ambiguous = tracked.ambiguity > kAmbiguous;

  std::vector<CornersOfTag> corners;
  for (const Seen& s : used) corners.push_back({s.matches, s.errors});
  const auto covariance = corner_covariance(corners, lens, *fit.best, expected);
  if (!covariance) return std::nullopt;
  tracked.covariance = *covariance;
  return tracked;
}

// For a rolling shutter: fits first as if all corners were seen at once, which may be pixels off.
std::optional<Tracked> fit_tags(const Detection& detection, const Measured& measured,
                                const Board& board, const Camera& camera,
                                const TrackingOptions& options) {
  if (!(camera.readout > 0)) return fit_still(detection, measured, board, camera, options);
  TrackingOptions wider = options;
  wider.largest_residual_px += kRollingResidual;
  auto tracked = fit_still(detection, measured, board, camera, wider);
  if (!tracked) return std::nullopt;
  roll_corners(board, camera,
               measured.empty() ? options.detected_noise_px : options.refined_noise_px, *tracked);
  double largest = 0;
  for (const DetectedTag& tag : tracked->tags) largest = std::max(largest, side_px(tag));
  if (tracked->last_row && !(tracked->residual_px <= options.largest_residual_px + 0.02 * largest))
    return std::nullopt;
  return tracked;
}

}  // namespace

void add_difference(const Pose& other, double share, Tracked& tracked) {
  const Pose& pose = tracked.camera_from_marker;
  const glm::dvec3 turn = rotation_vector(other.rotation * glm::transpose(pose.rotation)),
                   shift = other.translation - pose.translation;
  const std::array<double, 6> off{turn.x, turn.y, turn.z, shift.x, shift.y, shift.z};
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k) tracked.covariance[6 * i + k] += share * off[i] * off[k];
}

std::optional<Tracked> track(const Detection& detection, const Board& board, const Camera& camera,
                             const TrackingOptions& options) {
  return fit_tags(detection, {}, board, camera, options);
}

std::optional<Tracked> track(const Detection& detection, ImageView<const std::uint8_t> grey,
                             const Board& board, const Camera& camera,
                             const TrackingOptions& options) {
  if (!options.refine) return track(detection, board, camera, options);
  const auto refined = [&](const std::vector<DetectedTag>& tags) {
    return refine_tags(grey, tags, board.border_bits, camera, options.refining);
  };
  Detection better{{}, detection.start};
  Measured measured;
  for (const RefinedTag& tag : refined(detection.tags))
    better.tags.push_back(tag.tag), measured.push_back(tag.sides);
  const auto fitted = [&] {
    const bool any = std::any_of(measured.begin(), measured.end(),
                                 [](const auto& sides) { return sides.has_value(); });
    return fit_tags(better, any ? measured : Measured{}, board, camera, options);
  };
  const std::optional<Tracked> first = fitted();
  if (!first) return std::nullopt;

  // Sides that could not be found from the detector's corners can be from where the pose puts them.
  const Lens lens(camera);
  std::vector<DetectedTag> expected;
  std::vector<std::size_t> which;
  for (std::size_t k = 0; k < better.tags.size(); ++k) {
    if (measured[k]) continue;
    if (const auto tag = expected_tag(better.tags[k], board, lens, first->camera_from_marker))
      expected.push_back(*tag), which.push_back(k);
  }
  const std::vector<RefinedTag> again = refined(expected);
  for (std::size_t i = 0; i < which.size(); ++i)
    if (again[i].sides) better.tags[which[i]] = again[i].tag, measured[which[i]] = again[i].sides;
  better.start = first->camera_from_marker;
  return fitted();
}

std::optional<Tracked> track(const Detector& detector, ImageView<const std::uint8_t> grey,
                             const Board& board, const Camera& camera,
                             const TrackingOptions& options) {
  check(grey.channels == 1 && grey.width == camera.width && grey.height == camera.height,
        "track needs a grey picture of the camera's size ", camera.width, " × ", camera.height,
        ", got ", grey.width, " × ", grey.height, " with ", grey.channels, " channels");
  check_rows(grey, "a grey picture");
  return track(detector(grey, board, camera), grey, board, camera, options);
}

}  // namespace fastibl
