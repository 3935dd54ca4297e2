#include <algorithm>
#include <cmath>

#include "fastibl/core/solve.h"
#include "fastibl/tracking/board_misfit.h"
#include "fastibl/tracking/edge_tracker.h"
#include "fastibl/tracking/find_tags.h"
#include "fastibl/tracking/fit.h"
#include "fastibl/tracking/fit_edges.h"
#include "fastibl/tracking/fit_pixels.h"
#include "fastibl/tracking/roll_corners.h"

namespace fastibl {
namespace {

constexpr double kCodeHidden = 0.25;  // below, a tag is hidden or is another one
constexpr double kReadable = 1.6;     // px of a module, to hold its colour
constexpr double kClose = 0.55;       // mean match from which no tags are looked for
constexpr double kFits = 0.5;  // mean match of a right pose: 0.6 to 1 in hard films, 0.3 where
                               // edges are fitted to others
constexpr std::size_t kLeastTags = 3;  // whose shifts tell more than one shift of all
constexpr double kShiftError = 2;      // px of a tag's shift; farther off is another one
constexpr double kLeastShare = 0.15;   // of readable tags must be read, and of edges used
constexpr double kProvenShare = 0.5;   // the same where the start was not right
constexpr std::size_t kFarEdges = 200;
// From so many wide edges on, narrow ones, which err more, are left out.
constexpr std::size_t kWideEdges = 240;
constexpr double kNear = 0.5;       // px of motion over which edges are followed from close by
constexpr double kSettled = 0.02;   // px of motion in the last round
constexpr double kDoubtful = 0.15;  // px, median: above it, both minima are looked at at once
constexpr double kLargestResidual = 0.6;  // px, median: edges of something else
// How much worse, in squared deviations, the other minimum must fit for an ambiguity of a half; and
// the part of a difference that counts, because the edges' errors are not independent.
constexpr double kSurplus = 12;
constexpr double kSystematic = 0.08;

constexpr std::size_t kEdgesAlone = 1600;  // where pixels are of no use
constexpr std::size_t kPixels = 6500;      // tell nearly as much of the pose as all
constexpr double kCommon = 0.1;       // of the edges' variance: the part that pixels err by as well
constexpr double kAlike = 3e-4;       // px: all edges, which nothing in a picture tells
constexpr double kAgree = 16.8;       // squared distance of two poses: 99 % of six normal errors
constexpr double kDoubt = 170;        // the same from which pixels tell of something else
constexpr double kSlopeBlur = 0.798;  // deviation of a normal edge by half its width: sqrt(2 / pi)
constexpr double kLeastBlur = 0.5;    // px, with that of the pixels

constexpr double kSharp = 1.1, kShared = 0.01;  // px: `spread` of a sharp picture, error there
constexpr double kNarrow = 3;                   // times as much for edges with room for one pixel
constexpr double kUnevenGrowth = 0.25;          // of what white has grown, which differs by edge
constexpr double kSides = 8;                    // errors of a tag that are independent, about

struct Codes {
  std::vector<ProjectedTag> shown;  // tags that are not known to be hidden
  std::size_t readable = 0, seen = 0;
  double mean = 0;  // of the better half of the readable ones
};

// Leaves out tags that are hidden, or are not where they were expected.
Codes read_codes(const LightReader& light, const BoardPattern& pattern,
                 std::vector<ProjectedTag> tags) {
  Codes codes;
  std::vector<double> matches;
  for (ProjectedTag& tag : tags) {
    const bool readable = tag.module >= kReadable;
    const double match = code_match(light, pattern, tag);
    if (readable) matches.push_back(match);
    codes.readable += readable, codes.seen += match > kCodeSeen;
    if (match > kCodeHidden || !readable) codes.shown.push_back(std::move(tag));
  }
  std::sort(matches.rbegin(), matches.rend());
  const std::size_t half = (matches.size() + 1) / 2;
  for (std::size_t k = 0; k < half; ++k) codes.mean += matches[k] / double(half);
  return codes;
}

bool enough(const Codes& codes, double share) {
  return codes.seen > 0 && double(codes.seen) >= share * double(codes.readable);
}

// The pose moved sideways at the board's distance: a start for a shift of the picture.
Pose shifted(const Pose& pose, const glm::dvec2& shift, const Camera& camera) {
  Pose out = pose;
  const double z = pose.translation.z;
  out.translation += glm::dvec3(shift.x * z / camera.fx, shift.y * z / camera.fy, 0);
  return out;
}

// Where the tags' own shifts put the board; one or two tell only that it is shifted. tags: as they
// are projected from `pose`.
Pose moved_to_tags(const LightReader& light, const BoardPattern& pattern,
                   std::span<const ProjectedTag> tags, const Pose& pose, const Camera& camera,
                   const Lens& lens, double radius) {
  const std::vector<FoundTag> found = find_tags(light, pattern, tags, radius);
  if (found.empty()) return pose;
  const Pose start = shifted(pose, found[0].shift, camera);
  if (found.size() < kLeastTags) return start;
  // Compared with where a pose puts them without rolling: rolling is in both.
  std::vector<Match> matches;
  const auto n = std::size_t(pattern.modules), stride = n + 1;
  for (const FoundTag& tag : found)
    for (const std::size_t k : {std::size_t(0), n, n * stride, n * stride + n}) {
      const glm::dvec2& point = pattern.tags[tags[tag.which].index].nodes[k];
      if (const auto pixel = lens.project(pose * glm::dvec3(point, 0)))
        matches.push_back({point, *pixel + tag.shift, 1});
    }
  const auto fit = fit_pose(matches, lens, start, {Loss::Kind::huber, kShiftError});
  return fit ? fit->camera_from_marker : start;
}

double prior_cost(const PosePrior& prior, const Pose& pose) {
  double cost = 0;
  if (prior.rotation) {
    const double off = rotation_angle(*prior.rotation, pose.rotation) / prior.deviation;
    cost += off * off;
  }
  if (prior.gravity && glm::length(prior.gravity_in_marker) > 0) {
    const glm::dvec3 down = pose.rotation * glm::normalize(prior.gravity_in_marker);
    const double off =
        std::acos(std::clamp(glm::dot(down, *prior.gravity), -1.0, 1.0)) / (3 * kDegree);
    cost += off * off;
  }
  return cost;
}

struct Choice {
  Pose pose;
  double ambiguity = 0;
  bool other = false;  // the mirrored pose won
};

// Chooses between both planar minima, refined with the edges, by likelihood and by what was
// expected before. rows: of a rolling shutter.
Choice choose(std::span<const EdgePoint> points, const EdgeFit& fit, const Lens& lens,
              const PosePrior& prior, const Rows* rows) {
  Choice choice{fit.camera_from_marker, 0, false};
  const auto [low, high] = UsedRange(points, fit);
  const glm::dvec2 centre = 0.5 * (low + high);
  // The four corners of what is seen tell cheaply where the other minimum is, and how bad.
  std::vector<Match> corners;
  for (const glm::dvec2& p : {low, glm::dvec2(high.x, low.y), high, glm::dvec2(low.x, high.y)})
    if (const auto pixel = lens.project(choice.pose * glm::dvec3(p, 0)))
      corners.push_back({p, *pixel, 1});
  const auto start =
      fit_pose(corners, lens, mirrored_pose(choice.pose, centre), {Loss::Kind::huber, 1e6});
  if (!start) return choice;
  const auto differs = [&](const Pose& pose) {
    return rotation_angle(pose.rotation, choice.pose.rotation) > 0.5 * kDegree &&
           pose.inverse().translation.z > 0;
  };
  if (!differs(start->camera_from_marker)) return choice;
  // Where two minima lie far apart, edges fit the right one far better than by that distance.
  const double apart = std::sqrt(start->cost / 4);
  if (apart > 1 && fit.residual < 0.04 * apart) {
    choice.ambiguity = 1e-3;  // hundreds of deviations apart
    return choice;
  }
  std::vector<EdgePoint> still;
  if (rows) still = unrolled(points, lens, choice.pose, *rows), points = still;
  const auto other = refit_edges(points, fit, lens, start->camera_from_marker);
  if (!other || !differs(*other)) return choice;
  const double cost = edge_cost(points, fit, lens, choice.pose),
               other_cost = edge_cost(points, fit, lens, *other);
  const double surplus = kSystematic * (other_cost - cost);
  choice.ambiguity = kSurplus / (kSurplus + std::abs(surplus));
  if (surplus + prior_cost(prior, *other) - prior_cost(prior, choice.pose) < 0)
    choice.pose = *other, choice.other = true;
  return choice;
}

// Variance from the points' scatter, and from what they share: blur from neighbouring edges, ink
// and paper move the edges of a side together.
double variance_of(const EdgeFit& fit, std::span<const EdgePoint> points, std::size_t tags,
                   double spread) {
  double used = 0, weights = 0, narrow = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (fit.used[i]) {
      const double weight = 1 / (fit.deviation[i] * fit.deviation[i]);
      ++used, weights += weight, narrow += points[i].kind < 2 ? weight : 0;
    }
  const double blurred =
      kShared * (spread / kSharp) * (spread / kSharp) * (1 + kNarrow * narrow / weights);
  const double uneven =
      fit.growth == 0 ? 0 : std::max(kUnevenGrowth * std::abs(fit.growth), fit.residual);
  const double shared = std::hypot(blurred, uneven);
  const double together = used / (kSides * double(std::max<std::size_t>(tags, 1)));
  return 1 + shared * shared * std::max(1.0, together) * weights / used;
}

// A picture taken row by row, while it is tracked: what the rows' motion is expected to be, in the
// camera frame of the row that is taken when the middle of the board is.
struct Rolling {
  Rows rows;
  RowPrior prior;
};

// start, prior: of the first row; they become those of the board's middle row.
Rolling rolling_of(const BoardPattern& pattern, const Camera& camera, const Lens& lens,
                   PosePrior& prior, Pose& start) {
  Rolling out;
  out.prior = prior.rows.value_or(unknown_hand(start, camera.readout));
  const RowMotion first = out.prior.motion;
  out.rows.height = camera.height;
  out.rows.share = middle_share(pattern, camera, lens, first.moved(start, 0.5));
  out.prior = prior_of_row(out.prior, out.rows.share);
  out.rows.motion = out.prior.motion;
  start = first.moved(start, out.rows.share);
  if (prior.rotation)
    prior.rotation = rotation_from_vector(out.rows.share * first.turn) * *prior.rotation;
  return out;
}

// Turns the pose of the board's middle row into that of the first, with the motion's error added.
std::optional<RowState> to_first_row(const Rolling& rolling, const EdgeFit& fit, double variance,
                                     Tracked& tracked) {
  const Rows& rows = rolling.rows;
  const auto covariance = joint_covariance(fit.row_information, variance, tracked.covariance);
  if (!covariance) return std::nullopt;
  const RowState state =
      state_of_row({tracked.camera_from_marker, rows.motion, *covariance}, -rows.share);
  tracked.camera_from_marker = state.pose;
  tracked.last_row = state.motion.moved(state.pose, 1);
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      tracked.covariance[6 * i + k] = state.covariance[kRowParameters * i + k];
  return state;
}

// Squared distance of a motion from the pose that edges gave, by its covariance.
double distance_of(const std::array<double, 36>& covariance, const std::array<double, 6>& motion) {
  std::array<double, 6> x{};
  if (!solve_symmetric<6>(covariance, motion, x)) return 1e300;
  double distance = 0;
  for (std::size_t k = 0; k < 6; ++k) distance += x[k] * motion[k];
  return distance;
}

// Refines a pose by the light of the pixels at the edges of tags that are not hidden. Leaves it as
// it is where that contradicts the edges, and returns what the pixels say.
std::optional<Pose> refine(const LightReader& light, const BoardPattern& pattern,
                           const Codes& codes, std::vector<ProjectedTag> tags, const Lens& lens,
                           double spread, Tracked& tracked) {
  std::erase_if(tags, [&](const ProjectedTag& tag) {
    return std::none_of(codes.shown.begin(), codes.shown.end(),
                        [&](const ProjectedTag& shown) { return shown.index == tag.index; });
  });
  // An edge's profile is widened by its smoothing and by the difference that gives its slope.
  const double wide = kSlopeBlur * spread,
               blur = std::sqrt(std::max(wide * wide - 2.0 / 3, kLeastBlur * kLeastBlur));
  Pose& pose = tracked.camera_from_marker;
  const auto fit = fit_pixels(light, pattern, tags, lens, pose, blur, kPixels);
  if (!fit) return std::nullopt;
  const double distance = distance_of(tracked.covariance, fit->motion);
  const Pose by_pixels = moved(pose, fit->motion);
  if (!(distance < kAgree)) return distance < kDoubt ? std::optional(by_pixels) : std::nullopt;
  pose = by_pixels;
  tracked.pixels = int(fit->pixels);
  for (std::size_t k = 0; k < 36; ++k)
    tracked.covariance[k] = fit->covariance[k] + kCommon * tracked.covariance[k];
  return std::nullopt;
}

// The distance of the board's parts from their places moves the pose: as much as if all edges erred
// alike, because bent paper and lenses err smoothly.
void add_misfit(const EdgeFit& fit, Tracked& tracked) {
  double weights = 0;
  for (std::size_t i = 0; i < fit.used.size(); ++i)
    if (fit.used[i]) weights += 1 / (double(fit.deviation[i]) * double(fit.deviation[i]));
  std::array<double, 36> by_misfit{};
  const double variance = (tracked.misfit_px * tracked.misfit_px + kAlike * kAlike) * weights;
  if (!invert<6>(fit.information, by_misfit, variance)) return;
  for (std::size_t k = 0; k < 36; ++k) tracked.covariance[k] += by_misfit[k];
}

// Half the width of edges, px, from how steep they are.
double spread_of(std::span<const EdgePoint> points) {
  std::vector<double> slopes;
  for (const EdgePoint& p : points) slopes.push_back(p.steepness);
  const auto middle = slopes.begin() + std::ptrdiff_t(slopes.size() / 2);
  std::nth_element(slopes.begin(), middle, slopes.end());
  return 0.5 / std::max(*middle, 0.05);
}

// How many edges have room for two pixels on either side.
std::size_t wide_edges(std::span<const EdgePoint> points) {
  return std::size_t(
      std::count_if(points.begin(), points.end(), [](const EdgePoint& p) { return p.kind >= 2; }));
}

}  // namespace

EdgeModel::EdgeModel(const Board& board, const Camera& camera)
    : pattern_(pattern_of(board)),
      camera_(camera),
      lens_(camera_),
      grey_(camera.response, 1),
      colour_(camera.response, 3) {}

std::optional<Tracked> EdgeModel::track(ImageView<const std::uint8_t> picture, const Pose& start,
                                        const PosePrior& given, const EdgeTrackingOptions& options,
                                        RowState* state) const {
  check_rows(picture, "the picture");
  const LightReader light(picture, picture.channels == 1 ? grey_ : colour_);
  Pose pose = start;
  PosePrior prior = given;
  std::optional<Rolling> rolling;
  if (camera_.readout > 0) rolling = rolling_of(pattern_, camera_, lens_, prior, pose);
  const auto project = [&](const Pose& at) {
    return project_tags(pattern_, camera_, lens_, at, rolling ? &rolling->rows : nullptr);
  };
  const auto fit_to = [&](std::span<const EdgePoint> points) {
    if (!rolling) return fit_edges(points, lens_, pose);
    auto fit = fit_edges(points, lens_, pose, rolling->rows, rolling->prior);
    if (fit) rolling->rows.motion = fit->row_motion;
    return fit;
  };
  Codes codes = read_codes(light, pattern_, project(pose));
  // A search may have laid the board onto a shifted part of itself: more must agree then.
  const double share = codes.mean < kClose ? kProvenShare : kLeastShare;
  if (codes.mean < kClose && options.search_px > 0) {
    pose = moved_to_tags(light, pattern_, project(pose), pose, camera_, lens_, options.search_px);
    codes = read_codes(light, pattern_, project(pose));
  }
  if (codes.seen == 0 || codes.shown.empty()) return std::nullopt;

  EdgeSearch search;
  search.most = options.most_edges / 4;  // all of them once they are near
  search.all_of_few = prior.by_corners;
  for (int round = 0; round < 2; ++round) {  // from pixels away
    const FoundEdges far =
        find_edges(light, pattern_, codes.shown,
                   {.from_afar = true, .most = kFarEdges, .all_of_few = prior.by_corners});
    const auto fit = fit_to(far.points);
    if (!fit) break;
    search.spread = spread_of(far.points);
    if (fit->motion < kNear) break;  // from there, close by is more exact
    pose = fit->camera_from_marker;
    codes = read_codes(light, pattern_, project(pose));
  }
  if (!enough(codes, kLeastShare)) return std::nullopt;

  std::optional<EdgeFit> fit;
  FoundEdges near;
  Choice choice;
  int rounds = options.most_rounds;
  bool switched = false;
  for (int round = 0; round < rounds; ++round) {
    if (round > 0) codes = read_codes(light, pattern_, project(pose));
    near = find_edges(light, pattern_, codes.shown, search);
    fit = fit_to(near.points);
    if (!fit) return std::nullopt;
    pose = fit->camera_from_marker;
    const bool all = search.most == options.most_edges;
    if (!all && (near.all ? 1 : 4) * wide_edges(near.points) >= kWideEdges) search.least_reach = 2;
    search.most = options.most_edges;
    // In the wrong minimum a fit creeps and does not fit.
    const bool doubtful = !switched && round > 0 && fit->residual > kDoubtful;
    // Fewer edges tell less, and another round of them costs little.
    const double still = kSettled * double(near.points.size()) / double(options.most_edges);
    const bool settled = (fit->motion <= still && all) || round + 1 == rounds;
    if (!settled && !doubtful) continue;
    choice = choose(near.points, *fit, lens_, prior, rolling ? &rolling->rows : nullptr);
    if (settled && (!choice.other || switched)) break;
    if (!choice.other) continue;
    pose = choice.pose, switched = true;
    rounds = round + 1 + options.most_rounds;
  }

  const auto used = std::size_t(std::count(fit->used.begin(), fit->used.end(), true));
  if (!enough(codes, share) || double(used) < share * double(near.expected)) return std::nullopt;
  if (codes.readable > 0 && codes.mean < kFits) return std::nullopt;
  if (!(fit->residual < kLargestResidual)) return std::nullopt;
  Tracked tracked;
  tracked.camera_from_marker = pose;
  tracked.edges = int(used);
  tracked.residual_px = fit->residual;
  tracked.ambiguity = choice.ambiguity, tracked.ambiguous = choice.ambiguity > 0.5;
  double variance = variance_of(*fit, near.points, codes.shown.size(), search.spread);
  if (!invert<6>(fit->information, tracked.covariance, variance)) return std::nullopt;
  const auto& c = tracked.covariance;
  if (!(std::sqrt(c[0] + c[7] + c[14]) < options.largest_error * kDegree)) return std::nullopt;
  std::optional<Pose> contrary;
  if (fit->growth == 0)  // else pixels at edges are not as they would be
    contrary = refine(light, pattern_, codes, project(pose), lens_, search.spread, tracked);
  if (tracked.pixels == 0 && search.most < kEdgesAlone) {  // then by more edges
    search.most = kEdgesAlone;
    Codes again = read_codes(light, pattern_, project(pose));
    FoundEdges found = find_edges(light, pattern_, again.shown, search);
    const auto more = fit_to(found.points);
    auto covariance = tracked.covariance;
    const double by =
        more ? variance_of(*more, found.points, again.shown.size(), search.spread) : 0;
    if (more && more->motion < kNear && invert<6>(more->information, covariance, by)) {
      fit = more, variance = by, near = std::move(found);
      tracked.camera_from_marker = more->camera_from_marker, tracked.covariance = covariance;
      tracked.edges = int(std::count(more->used.begin(), more->used.end(), true));
      tracked.residual_px = more->residual;
    }
  }
  if (contrary) add_difference(*contrary, 0.5, tracked);  // it may as well be that one
  // White that has grown unevenly lies beside its places, too.
  tracked.misfit_px = board_misfit(near.points, *fit, fit->growth == 0 ? variance : 1);
  add_misfit(*fit, tracked);
  if (rolling) {
    const auto found = to_first_row(*rolling, *fit, variance, tracked);
    if (!found) return std::nullopt;
    if (state) *state = *found;
  }
  const auto n = std::size_t(pattern_.modules), stride = n + 1;
  for (const ProjectedTag& tag : codes.shown)
    tracked.tags.push_back(
        {pattern_.tags[tag.index].id,
         {tag.nodes[0], tag.nodes[n], tag.nodes[n * stride + n], tag.nodes[n * stride]}});
  return tracked;
}

}  // namespace fastibl
