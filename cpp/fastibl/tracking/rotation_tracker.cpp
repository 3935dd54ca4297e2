#include "fastibl/tracking/rotation_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr int kFewToCompare = 300;  // features of a picture, to see whether it agrees
constexpr double kAgrees = 0.75, kAgreeing = 0.93;  // of Alignment::residual and agreeing
constexpr int kFewestToAgree = 50;                  // features
constexpr int kAttempts = 2;  // each one starts from the result of the one before
// Where a rotation is expected no better than to kWide radians, no other one may agree about as
// well: one within kReach deviations, with at least kSimilar of the features and a residual up to
// kAsGood times as large.
constexpr double kWide = kDegree;
constexpr double kReach = 2, kSimilar = 0.5, kAsGood = 1.5;
constexpr double kWidest = 3 * kWide;  // radians, above which so many features have to agree
constexpr int kFew = 40;
constexpr double kApart = kWide;  // radians, above which a rotation is another one
// Of the largest residual, where a rotation is expected better than to kWide: it is hardly a wrong
// one.
constexpr double kNear = 1.5;
// Of the largest residual: beyond, what is seen contradicts a gyroscope; near walls and blur do
// not.
constexpr double kContradicts = 3;
constexpr double kBlank =
    0.4;  // log2: deviation of a picture's large parts that vignetting may have
// Seconds by which one camera's picture may come after the other's and be of the same moment.
constexpr double kSameMoment = 2e-3;
constexpr double kLongestStep = 0.3;      // seconds between poses that give a velocity
constexpr double kKnown = 3e-4;           // radians: deviation of a known pose
constexpr double kKnownPlace = 1e-3;      // metres: likewise
constexpr double kFoundPlace = 0.01;      // likewise of one that rests on near things: no sphere
constexpr double kUnknownVelocity = 1.0;  // rad/s
// Largest eigenvalue of a symmetric positive matrix.
double largest_eigenvalue(const glm::dmat3& m) {
  glm::dmat3 a = m;
  for (int sweep = 0; sweep < 12; ++sweep)  // Jacobi
    for (int p = 0; p < 2; ++p)
      for (int q = p + 1; q < 3; ++q) {
        if (std::abs(a[p][q]) < 1e-300) continue;
        const double theta = 0.5 * std::atan2(2 * a[p][q], a[q][q] - a[p][p]);
        glm::dmat3 g(1.0);
        g[p][p] = g[q][q] = std::cos(theta);
        g[p][q] = -std::sin(theta), g[q][p] = std::sin(theta);
        a = glm::transpose(g) * a * g;
      }
  return std::max({a[0][0], a[1][1], a[2][2]});
}

double mean_variance(const glm::dmat3& covariance) {
  return (covariance[0][0] + covariance[1][1] + covariance[2][2]) / 3;
}

// Whether a picture shows more than one bright or dark thing all over.
bool shows_something(const MapView& view) {
  const LightPyramid::Level& level = view.light->level(LightPyramid::kLevels - 1);
  double sum = 0, squares = 0;
  for (const float light : level.light) {
    const double value = std::log2(std::clamp(double(light), 1e-4, 1.0));
    sum += value, squares += value * value;
  }
  const double count = double(std::max<std::size_t>(level.light.size(), 1)), mean = sum / count;
  return squares / count - mean * mean > kBlank * kBlank;
}

Pose pose_at(const glm::dmat3& rotation, const glm::dvec3& eye) {
  return {rotation, -(rotation * eye)};
}

Rig validated(Rig rig) {
  rig.validate();
  return rig;
}

}  // namespace

RotationTracker::RotationTracker(Rig rig, RotationTrackingOptions options)
    : rig_(validated(std::move(rig))),
      options_(options),
      back_lens_(rig_.back),
      back_rays_(rig_.back, back_lens_) {
  check(rig_.back.model == CameraModel::perspective &&
            (!rig_.front || rig_.front->model == CameraModel::perspective),
        "a rotation is tracked with perspective cameras alone");
  if (rig_.front) front_lens_.emplace(*rig_.front), front_rays_.emplace(*rig_.front, *front_lens_);
  check(options_.acceleration > 0 && options_.largest_error > 0 && options_.longest_gap > 0,
        "acceleration, largest_error and longest_gap must be positive, got ", options_.acceleration,
        " ", options_.largest_error, " ", options_.longest_gap);
  check(options_.gyro_noise >= 0 && options_.gyro_scale >= 0 &&
            std::isfinite(options_.gyro_noise + options_.gyro_scale),
        "gyro_noise and gyro_scale must be 0 or more, got ", options_.gyro_noise, " ",
        options_.gyro_scale);
  check(options_.wander >= 0 && std::isfinite(options_.wander),
        "wander must be 0 or more and finite, got ", options_.wander);
  check(options_.largest_residual > 0 && options_.sure > 0 && options_.least_agreeing >= 0 &&
            options_.least_agreeing <= 1,
        "largest_residual and sure must be positive, least_agreeing from 0 to 1, got ",
        options_.largest_residual, " ", options_.sure, " ", options_.least_agreeing);
  const AlignmentOptions& a = options_.alignment;
  check(a.coarsest >= 0 && a.coarsest < MapFeatures::kLevels && a.rounds > 0 && a.most > 0,
        "an alignment begins at level 0 to ", MapFeatures::kLevels - 1,
        ", has rounds and features, got ", a.coarsest, ", ", a.rounds, " and ", a.most);
}

void RotationTracker::reset() { state_.reset(); }

void RotationTracker::forget() {
  reset();
  features_.clear(), fine_.clear();
  last_drift_ = found_drift_ = 0;
}

void RotationTracker::set_surface(const MapSurface& surface) {
  if (surface == surface_) return;
  surface_ = surface;
  fine_.clear();
}

Agreement RotationTracker::compare(const Pose& back_from_marker, const RigPictures& pictures) {
  check_pictures(pictures);
  AlignmentOptions options = options_.alignment;
  options.coarsest = options.rounds = 0;
  options.note = false;
  options.most = kFewToCompare;
  const State* state = state_ ? &*state_ : nullptr;
  const glm::dmat3& rotation = back_from_marker.rotation;
  const auto found = align_rotation(features_, fine_, views(pictures, state, back_from_marker),
                                    rotation, {rotation, glm::dmat3(1e12)}, options);
  if (!found || found->features < kFewestToAgree) return Agreement::nothing;
  const bool agrees = found->residual <= kAgrees && found->agreeing >= kAgreeing;
  return agrees ? Agreement::agrees : Agreement::differs;
}

// A new rotation, near that of `state`, with its own covariance; the velocity follows it.
void RotationTracker::correct(State& state, const glm::dmat3& rotation,
                              const glm::dmat3& covariance) {
  const glm::dvec3 w = rotation_vector(glm::transpose(state.rotation) * rotation);
  const glm::dmat3 inverse = glm::inverse(state.ww), vw = glm::transpose(state.wv);
  const glm::dmat3 gain = vw * inverse;  // of the velocity
  state.velocity += gain * w;
  state.vv -= gain * (state.ww - covariance) * glm::transpose(gain);
  state.wv = covariance * inverse * state.wv;
  state.ww = covariance;
  state.rotation = rotation;
  state.told = glm::dvec3(0);
}

void RotationTracker::start(const Pose& back_from_marker, double time, const RigPictures& pictures,
                            double variance) {
  check(std::isfinite(time) && (!state_ || time >= state_->time),
        "time must not run backwards: ", time, " s after ", state_ ? state_->time : 0, " s");
  check(variance >= 0 && std::isfinite(variance), "a variance must be 0 or more and finite, got ",
        variance);
  check_pictures(pictures);
  const glm::dmat3 known(kKnown * kKnown);
  if (state_ && time - state_->time <= kLongestStep) {
    state_ = predicted(time, {}, 0);
    correct(*state_, back_from_marker.rotation, known);
  } else {
    state_ = State{back_from_marker.rotation,
                   glm::dvec3(0),
                   known,
                   glm::dmat3(0.0),
                   glm::dmat3(kUnknownVelocity * kUnknownVelocity),
                   time,
                   glm::dvec3(0)};
  }
  if (pictures.velocity) state_->velocity = *pictures.velocity;
  eye_ = back_from_marker.inverse().translation, place_ = glm::dmat3(kKnownPlace * kKnownPlace);
  // What the pictures show is then off by as much as the pose is, all of it alike.
  known_ = found_ = time, last_drift_ = found_drift_ = variance, contradicted_ = false;
  add_features(views(pictures, &*state_, back_from_marker));
}

// Constant angular velocity but for a hand's accelerations; or a gyroscope's turn.
RotationTracker::State RotationTracker::predicted(double time,
                                                  const std::optional<glm::dmat3>& turn,
                                                  double variance) const {
  State s = *state_;
  const double t = time - s.time;
  s.time = time;
  if (turn) {
    const glm::dmat3 rotation = orthonormal(*turn * s.rotation);
    const glm::dvec3 w = rotation_vector(glm::transpose(s.rotation) * rotation);
    s.rotation = rotation;
    if (t > 0) {
      const double noise = options_.gyro_noise * options_.gyro_noise;
      s.velocity = w / t;
      const double scale = options_.gyro_scale * options_.gyro_scale;
      const glm::dvec3 told = s.told + w;  // a wrong scale is wrong all the way
      s.ww += glm::dmat3(noise * t + variance) +
              scale * (glm::outerProduct(told, told) - glm::outerProduct(s.told, s.told));
      s.wv = glm::dmat3(0.0), s.vv = glm::dmat3(noise / t + variance / (t * t)), s.told = told;
    }
    return s;
  }
  s.rotation = orthonormal(s.rotation * rotation_from_vector(s.velocity * t));
  // The acceleration changes on the way: a constant one would make up for a wrong velocity with one
  // as wrong the other way, for ever.
  const double a2 = options_.acceleration * options_.acceleration;
  s.ww += t * (s.wv + glm::transpose(s.wv)) + t * t * s.vv + glm::dmat3(a2 * t * t * t * t / 3);
  s.wv += t * s.vv + glm::dmat3(a2 * t * t * t / 2);
  s.vv += glm::dmat3(a2 * t * t);
  return s;
}

void RotationTracker::add_features(const std::vector<MapView>& views) {
  for (const MapView& view : views)
    fine_.add(view, view.camera == &rig_.back ? back_rays_ : *front_rays_, state_->rotation,
              float(last_drift_), features_.dark());
}

void RotationTracker::check_pictures(const RigPictures& pictures) const {
  const auto check_of = [](const Picture& picture, const Camera& camera, double exposure) {
    check(picture.width == camera.width && picture.height == camera.height,
          "the picture must be the camera's ", camera.width, " × ", camera.height, ", got ",
          picture.width, " × ", picture.height);
    check_picture(picture);
    check(exposure > 0 && std::isfinite(exposure), "an exposure must be positive and finite, got ",
          exposure);
  };
  if (!pictures.back.empty()) check_of(pictures.back, rig_.back, pictures.back_exposure);
  if (pictures.front.empty()) return;
  check(rig_.front.has_value(), "a front picture came, but the rig has no front camera");
  check_of(pictures.front, *rig_.front, pictures.front_exposure);
}

// state: at the time of the pictures, for rolling shutters.
std::vector<MapView> RotationTracker::views(const RigPictures& pictures, const State* state,
                                            const Pose& back_from_marker) {
  std::vector<MapView> views;
  const glm::dvec3 velocity = pictures.velocity ? *pictures.velocity
                              : state           ? state->velocity
                                                : glm::dvec3(0);
  // A rotation is off because the velocity was.
  glm::dmat3 velocity_by_w(0.0);
  if (state && !pictures.velocity)
    velocity_by_w = glm::transpose(state->wv) * glm::inverse(state->ww);
  const bool ready = pictures.number != 0 && pictures.number == lit_;
  const auto add = [&](const Picture& picture, const Camera& camera, const Lens& lens,
                       LightPyramid& light, const Pose& camera_from_rig, double exposure) {
    if (!ready) light.make(picture, camera.response);
    views.push_back({&light, &camera, &lens, camera_from_rig.rotation, exposure,
                     camera.readout * velocity, camera.readout * velocity_by_w, surface_,
                     (camera_from_rig * back_from_marker).inverse().translation});
  };
  if (!pictures.back.empty())
    add(pictures.back, rig_.back, back_lens_, back_light_, Pose{}, pictures.back_exposure);
  if (!pictures.front.empty()) {
    add(pictures.front, *rig_.front, *front_lens_, front_light_, rig_.front_from_back,
        pictures.front_exposure);
  }
  lit_ = pictures.number;
  return views;
}

// Nothing where the rotation is less sure than it must be. drift: variance.
std::optional<Turned> RotationTracker::turned(const Pose& back_from_marker,
                                              const glm::dmat3& covariance, double drift,
                                              double time) const {
  const glm::dmat3& rotation = back_from_marker.rotation;
  const double most = options_.largest_error * kDegree;
  if (!(largest_eigenvalue(covariance) + drift <= most * most)) return std::nullopt;
  Turned out;
  out.back_from_marker = back_from_marker;
  const glm::dmat3 seen = rotation * (covariance + glm::dmat3(drift)) * glm::transpose(rotation);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out.covariance[std::size_t(3 * r + c)] = seen[c][r];
  out.drift = std::sqrt(drift);
  out.since = time - known_;
  out.position_deviation = std::sqrt(largest_eigenvalue(place_));
  out.velocity = state_->velocity;
  return out;
}

// Whether no other rotation that may be expected agrees with the pictures about as well; others are
// sought from places all around.
bool RotationTracker::is_only_one(const Alignment& found, const RotationPrior& prior,
                                  const std::vector<MapView>& seen) const {
  AlignmentOptions options = options_.alignment;
  options.note = false;
  const double reach = kReach * std::sqrt(largest_eigenvalue(state_->ww));
  for (int k = 0; k < 6; ++k) {
    glm::dvec3 w(0);
    w[k / 2] = k % 2 == 0 ? reach : -reach;
    const glm::dmat3 start = found.rotation * rotation_from_vector(w);
    const std::optional<Alignment> other =
        align_rotation(features_, fine_, seen, start, prior, options);
    if (!other || other->features < kSimilar * found.features) continue;
    const double apart = rotation_angle(orthonormal(other->rotation), orthonormal(found.rotation));
    if (apart > kApart && other->residual <= kAsGood * found.residual &&
        other->agreeing >= options_.least_agreeing)
      return false;
  }
  return true;
}

std::optional<Turned> RotationTracker::judged(const Alignment& found, double time) const {
  const double expected = std::sqrt(largest_eigenvalue(state_->ww));
  const double most = expected > kWide ? 1 : kNear;
  const double least = expected > kWidest ? kAgreeing : 0;
  if (!(found.residual <= most * options_.largest_residual &&
        found.agreeing >= std::max(least, options_.least_agreeing)))
    return std::nullopt;
  std::optional<Turned> out = turned(pose_at(orthonormal(found.rotation), eye_ + found.moved),
                                     glm::inverse(found.information), found.drift, time);
  if (!out) return std::nullopt;
  out->residual = found.residual, out->agreeing = found.agreeing, out->features = found.features;
  return out;
}

std::optional<Turned> RotationTracker::track(const Environment& environment,
                                             const RigPictures& pictures, double time,
                                             const std::optional<glm::dmat3>& turn,
                                             double turn_variance) {
  check(std::isfinite(time) && (!state_ || time >= state_->time),
        "time must not run backwards: ", time, " s after ", state_ ? state_->time : 0, " s");
  check(!turn || is_rotation(*turn, 1e-3), "the turn must be a finite rotation");
  check(environment.radiance.size() > 0, "the environment has no map");
  environment.validate();
  check_pictures(pictures);
  if (!state_) return std::nullopt;
  place_ += glm::dmat3(options_.wander * options_.wander * (time - state_->time));
  state_ = predicted(time, turn, turn_variance);
  if (time - found_ > options_.longest_gap && !turn) {
    reset();
    return std::nullopt;
  }
  features_.update(environment, last_drift_);
  std::vector<MapView> seen = views(pictures, &*state_, pose_at(state_->rotation, eye_));
  if (seen.empty()) return std::nullopt;
  RotationPrior prior{state_->rotation, glm::inverse(state_->ww)};
  if (surface_.is_near()) prior.place_information = glm::inverse(place_);
  std::optional<Alignment> found;
  std::optional<Turned> result;
  for (int attempt = 0; attempt < kAttempts && !result; ++attempt) {
    found = align_rotation(features_, fine_, seen, found ? found->rotation : prior.rotation, prior,
                           options_.alignment);
    if (!found) break;
    result = judged(*found, time);
    contradicted_ |= !result && found->residual > kContradicts * options_.largest_residual &&
                     std::any_of(seen.begin(), seen.end(), shows_something);
  }
  // Where little is known of the rotation, few features may agree by chance, and so does a pattern
  // that repeats itself.
  const double expected = std::sqrt(largest_eigenvalue(state_->ww));
  if (result && ((expected > kWidest && result->features < kFew) ||
                 (expected > kWide && !is_only_one(*found, prior, seen))))
    result.reset();
  if (result) {
    correct(*state_, result->back_from_marker.rotation, glm::inverse(found->information));
    if (prior.place_information) {
      eye_ += found->moved, place_ = found->place_covariance;
      for (MapView& view : seen) view.eye += found->moved;
      result->position_deviation = std::hypot(std::sqrt(largest_eigenvalue(place_)), kFoundPlace);
    }
    result->velocity = state_->velocity;
    const bool back = !pictures.back.empty();
    if (back) result->back_gain = found->gains[0];
    if (!pictures.front.empty()) result->front_gain = found->gains[back];
    found_ = time, found_drift_ = found->drift, contradicted_ = false;
    fine_.forget_missed();
  } else if ((turn || time - found_ <= kSameMoment) && !contradicted_) {
    result = turned(pose_at(state_->rotation, eye_), state_->ww, found_drift_, time);
  }
  if (!result) return std::nullopt;
  last_drift_ = mean_variance(state_->ww) + found_drift_;
  const double sure = options_.sure * kDegree;
  if (3 * mean_variance(state_->ww) < sure * sure) add_features(seen);
  return result;
}

}  // namespace fastibl
