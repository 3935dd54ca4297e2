#include "fastibl/tracking/align_rotation.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "fastibl/core/check.h"
#include "fastibl/core/solve.h"

namespace fastibl {
namespace {

constexpr std::size_t kFewest = 12;
constexpr float kRelinearise = 0.01f;  // radians, metres: beyond, pixels are projected anew
constexpr float kDone = 2e-5f;         // radians, metres
constexpr float kTukey = 4.7f;         // robust standard deviations, 95 % efficient
constexpr double kLeastScale = 0.5;
// Noise of a pixel, linear: deviation in the dark, variance by light; for a small sensor and codes
// of 8 bits. Sensors that cut off noise at 0 are too bright in the dark.
constexpr float kReadNoise = 0.002f, kShotNoise = 1 / 3000.0f, kDarkBias = 0.4f;
constexpr float kDarkest = 0.003f;  // of white: below there is only noise
constexpr float kDark = 0.0005f;    // of white: differences below hardly count
constexpr float kUsualBlock = 4;    // pixels
constexpr int kRowPasses = 2;       // in which the row that shows a place is found
constexpr float kWhite = 0.97f;     // linear; what is expected above it tells nothing

// log2, within 1e-4.
inline float fast_log2(float x) {
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(x);
  const float e = float(int(bits >> 23) - 127);
  const float m = std::bit_cast<float>((bits & 0x007fffffu) | 0x3f800000u);  // in [1, 2)
  const float t = m - 1;
  return e +
         t * (1.44254494f +
              t * (-0.71814525f +
                   t * (0.45754919f + t * (-0.27790446f + t * (0.12197510f + t * -0.02602027f)))));
}
constexpr float kLn2 = 0.693147181f;

// A feature in a picture: pixel at a rotation, and how it moves with w.
struct Seen {
  float x, y;
  glm::vec3 move_x, move_y;  // of the pixel by w
  glm::vec3 axis;            // of the logarithm
  float log_light, inverse_deviation, dark, scale;
  int level;
  const MapFeature* feature;
  glm::vec3 eye_x{0}, eye_y{0};  // of the pixel by the eye's shift, 1 / metres
  glm::vec3 eye_axis{0};         // of the logarithm by it
};

glm::dmat3 cross_matrix(const glm::dvec3& w) { return {0, w.z, -w.y, -w.z, 0, w.x, w.y, -w.x, 0}; }

struct Candidate {
  float information;
  const MapFeature* feature;
};

// How a picture shows light of the map.
struct Sensor {
  float white;  // radiance
  float dark;   // radiance, is added before logarithms are taken
  float off;    // widths of a feature by which it may be misplaced

  // Variance of the logarithm, read in blocks of `block` pixels: from about 2.25 block² of them.
  float variance(const MapFeature& f, const AlignmentOptions& options, float block) const {
    const float level = f.light / white, light = f.light + dark;
    const float bias = kDarkBias * kReadNoise * std::max(0.0f, 1 - level / (1.5f * kReadNoise));
    const float noise =
        (kReadNoise * kReadNoise + kShotNoise * level) / (2.25f * block * block) + bias * bias;
    const float misfit = off * f.width;
    const float by_angle = misfit * misfit + f.drift;
    const float model = float(options.model_noise * options.model_noise);
    return model + (by_angle * glm::dot(f.axis, f.axis) +
                    std::max(f.variance, 0.0f) * f.light * f.light + noise * white * white) /
                       (light * light);
  }
};

// Features near a direction, of tiles that a picture may show.
class Candidates {
 public:
  Candidates(const Camera& camera, const Sensor& sensor, const glm::dvec3& axis,
             const AlignmentOptions& options, std::vector<Candidate>& out)
      : sensor_(sensor), axis_(axis), options_(options), out_(out) {
    // Half the angle across the picture's diagonal, generously: lenses differ.
    const double corner = std::hypot(std::max(camera.cx, camera.width - camera.cx) / camera.fx,
                                     std::max(camera.cy, camera.height - camera.cy) / camera.fy);
    const double half = std::min(std::atan(1.3 * corner) + 0.05, 1.5);
    cosine_ = float(std::cos(half)), sine_ = float(std::sin(half));
    out_.clear();
  }

  // Whether the angle to the axis is below the sum of both angles, which is below half a turn.
  // reach: cosine.
  bool shows(const glm::vec3& middle, float reach) const {
    return glm::dot(middle, axis_) >
           cosine_ * reach - sine_ * std::sqrt(std::max(1 - reach * reach, 0.0f));
  }
  void add(const std::vector<MapFeature>& features) {
    for (const MapFeature& f : features) {
      if (!(f.light > kDarkest * sensor_.white && f.light < kWhite * sensor_.white)) continue;
      const float light = f.light + sensor_.dark;
      const float variance = sensor_.variance(f, options_, kUsualBlock);
      out_.push_back({glm::dot(f.axis, f.axis) / (light * light * variance), &f});
    }
  }
  // Keeps the candidates that tell most.
  void limit(int most) {
    if (int(out_.size()) <= most) return;
    const auto middle = out_.begin() + most;
    std::nth_element(out_.begin(), middle, out_.end(), [](const Candidate& a, const Candidate& b) {
      return a.information > b.information;
    });
    out_.erase(middle, out_.end());
  }

 private:
  const Sensor& sensor_;
  glm::vec3 axis_;
  const AlignmentOptions& options_;
  std::vector<Candidate>& out_;
  float cosine_, sine_;
};

// Tells cheaply for most directions that a picture does not show them: by its rectangle, with ample
// room for what its lens bends.
class Outside {
 public:
  Outside(const Camera& camera, const glm::dmat3& rotation)
      : rotation_(rotation),
        x_(float(kGenerous * std::max(camera.cx, camera.width - camera.cx) / camera.fx)),
        y_(float(kGenerous * std::max(camera.cy, camera.height - camera.cy) / camera.fy)) {}
  bool operator()(const glm::vec3& direction) const {
    const glm::vec3 d = rotation_ * direction;
    return !(d.z > 0 && std::abs(d.x) <= x_ * d.z && std::abs(d.y) <= y_ * d.z);
  }

 private:
  static constexpr double kGenerous = 1.4;
  glm::mat3 rotation_;
  float x_, y_;
};

// Projects the features of a level that a picture shows. by_eye: also how they move with the eye.
void find_seen(const MapFeatures& map, const PictureFeatures& fine, const MapView& view,
               const glm::dmat3& rig_from_marker, int level, bool by_eye,
               const AlignmentOptions& options, std::vector<Candidate>& scratch,
               std::vector<Seen>& out) {
  const Camera& camera = *view.camera;
  const glm::dmat3 rotation = view.camera_from_rig * rig_from_marker;
  const float white = float(1 / std::max(view.exposure * camera.gain, 1e-30));
  const float dark = float(map.dark()) + kDark * white;
  const float off = float(level == 0 ? options.misfit : options.coarse_misfit);
  const Sensor whole{white, dark, off};
  const glm::dvec3 looks = glm::transpose(rotation) * glm::dvec3(0, 0, 1);
  Candidates candidates(camera, whole, view.recorded(looks), options, scratch);
  for (const PictureFeatures::Tile& tile : fine.tiles())
    if (!tile.features[level].empty() && candidates.shows(tile.cone.middle, tile.cone.reach))
      candidates.add(tile.features[level]);
  for (const MapFeatures::Tile& tile : map.tiles())
    if (!tile.features[level].empty() && candidates.shows(tile.cone.middle, tile.cone.reach) &&
        fine.around(tile.cone.middle, level) == 0)
      candidates.add(tile.features[level]);
  if (level == 0) candidates.limit(options.most);
  const Outside outside(camera, rotation);
  const bool rolls = view.turn != glm::dvec3(0) || view.turn_by_w != glm::dmat3(0.0);
  for (const Candidate& candidate : scratch) {
    const MapFeature& f = *candidate.feature;
    const glm::dvec3 d = view.seen(glm::dvec3(f.direction));
    if (outside(glm::vec3(d))) continue;
    glm::dmat2x3 derivative;
    glm::dmat3 row(1.0), by_w(1.0);  // the turn until the row that shows it, and its change by w
    auto pixel = view.lens->project(rotation * d, &derivative);
    for (int pass = 0; pass < kRowPasses && rolls && pixel; ++pass) {
      const double share = std::clamp(pixel->y / camera.height, 0.0, 1.0);
      row = rotation_from_vector(share * view.turn);
      by_w = glm::dmat3(1.0) + share * view.turn_by_w;
      pixel = view.lens->project(rotation * (row * d), &derivative);
    }
    if (!pixel || !camera.inside(*pixel)) continue;
    const double vignette = camera.vignetting.empty() ? 1.0 : camera.vignette(*pixel);
    const Sensor sensor{float(double(white) / vignette), dark, off};
    if (f.light > kWhite * sensor.white) continue;
    // d(rotation exp([w]×) d) = rotation (w × d): rows of the pixel's derivative, in w.
    const glm::dmat3 turned = rotation * cross_matrix(row * d) * by_w * -1.0;
    const glm::dvec3 mx = derivative[0] * turned, my = derivative[1] * turned;
    const double pixels = std::sqrt(glm::length(mx) * glm::length(my)) * double(f.width);
    // A bilinear look-up in means of b pixels has the variance of a box of √3 b.
    const double wanted =
        std::log2(std::max(pixels / std::sqrt(3.0) / LightPyramid::kFirstBlock, 1.0));
    const int read = std::clamp(int(wanted + 0.5), 0, LightPyramid::kLevels - 1);
    const float variance = sensor.variance(f, options, float(view.light->level(read).block));
    const float light = f.light + dark;
    const glm::vec3 axis = rolls ? glm::vec3((row * glm::dvec3(f.axis)) * by_w) : f.axis;
    Seen& seen = out.emplace_back(Seen{float(pixel->x), float(pixel->y), glm::vec3(mx),
                                       glm::vec3(my), axis / light, kLn2 * fast_log2(light),
                                       1 / std::sqrt(variance), dark, sensor.white, read, &f});
    if (by_eye) {  // moved by m, it is seen in d − nearness · m
      const double nearness = view.surface.nearness(glm::dvec3(f.direction));
      const glm::dmat3 moved = -nearness * (rotation * row);
      seen.eye_x = glm::vec3(derivative[0] * moved), seen.eye_y = glm::vec3(derivative[1] * moved);
      const glm::vec3 gradient = glm::cross(f.axis, glm::vec3(d));  // times |d|²
      seen.eye_axis = -float(nearness / glm::dot(d, d)) * gradient / light;
    }
  }
}

// w, and the shift of the eyes where that is in doubt.
constexpr std::size_t kUnknowns = 6;
using Step = std::array<double, kUnknowns>;

glm::dvec3 turn_of(const Step& step) { return {step[0], step[1], step[2]}; }
glm::dvec3 shift_of(const Step& step) { return {step[3], step[4], step[5]}; }

// Normal equations of the first `count` unknowns.
struct Normal {
  std::size_t count;
  std::array<double, kUnknowns * kUnknowns> a{};  // row by row, of `count` columns
  Step b{};

  double& at(std::size_t r, std::size_t c) { return a[count * r + c]; }
  double at(std::size_t r, std::size_t c) const { return a[count * r + c]; }
  void add(const Normal& other) {
    for (std::size_t i = 0; i < count * count; ++i) a[i] += other.a[i];
    for (std::size_t i = 0; i < count; ++i) b[i] += other.b[i];
  }
  // What is known before of the three unknowns from `first` on, which are at `now`.
  void add_prior(std::size_t first, const glm::dmat3& information, const glm::dvec3& now) {
    const glm::dvec3 pull = information * now;
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) at(first + r, first + c) += information[int(c)][int(r)];
      b[first + r] -= pull[int(r)];
    }
  }
  glm::dmat3 block(std::size_t row, std::size_t column) const {
    glm::dmat3 m;
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t c = 0; c < 3; ++c) m[int(c)][int(r)] = at(row + r, column + c);
    return m;
  }
  // False where they tell nothing of a direction.
  bool solve(Step& step) const {
    std::array<double, kUnknowns* kUnknowns> matrix = a;
    step = b;
    return solve_in_place(std::span(matrix).first(count * count), std::span(step).first(count));
  }
};

// Those of one picture with the logarithm of its gain, which does not depend on the other
// picture's.
struct GainNormal {
  Normal own{3};
  Step by_gain{};  // of the unknowns and the gain
  double gain = 0, gain_b = 0;

  // Those of the unknowns, with the gain that is best for them (Schur).
  Normal without_gain() const {
    Normal n = own;
    for (std::size_t r = 0; r < n.count; ++r) {
      for (std::size_t c = 0; c < n.count; ++c) n.at(r, c) -= by_gain[r] * by_gain[c] / gain;
      n.b[r] -= by_gain[r] * (gain_b / gain);
    }
    return n;
  }
  double gain_step(const Step& step) const {
    double sum = gain_b;
    for (std::size_t i = 0; i < own.count; ++i) sum -= by_gain[i] * step[i];
    return sum / gain;
  }
};
using LogGains = std::array<double, kMostViews>;

class Level {
 public:
  // by_eye: whether the place of the eyes is sought, too.
  Level(const MapFeatures& map, const PictureFeatures& fine, std::span<const MapView> views,
        int level, bool by_eye, const AlignmentOptions& options)
      : map_(map), fine_(fine), views_(views), level_(level), by_eye_(by_eye), options_(options) {}

  void project(const glm::dmat3& rotation) {
    seen_.clear(), begin_.clear();
    for (const MapView& view : views_) {
      begin_.push_back(seen_.size());
      find_seen(map_, fine_, view, rotation, level_, by_eye_, options_, scratch_, seen_);
    }
    begin_.push_back(seen_.size());
    residuals_.resize(seen_.size());
  }

  // Reads features where a step leads from where they were projected, with these gains. Returns how
  // many could be read.
  std::size_t read(const Step& step, const LogGains& log_gains) {
    const glm::vec3 w(turn_of(step)), m(shift_of(step));
    sizes_.clear();
    for (std::size_t v = 0; v + 1 < begin_.size(); ++v) {
      const LightPyramid& light = *views_[v].light;
      const float log_gain = float(log_gains[v]);
      for (std::size_t i = begin_[v]; i < begin_[v + 1]; ++i) {
        const Seen& s = seen_[i];
        float x = s.x + glm::dot(s.move_x, w), y = s.y + glm::dot(s.move_y, w);
        if (by_eye_) x += glm::dot(s.eye_x, m), y += glm::dot(s.eye_y, m);
        const float value = light.read(s.level, x, y);
        if (!(value >= 0 && value <= 1)) {
          residuals_[i] = std::numeric_limits<float>::quiet_NaN();
          continue;
        }
        const float logarithm = kLn2 * fast_log2(value * s.scale + s.dark);
        residuals_[i] = (logarithm - s.log_light - log_gain) * s.inverse_deviation;
        sizes_.push_back(std::abs(residuals_[i]));
      }
    }
    return sizes_.size();
  }

  // Robust standard deviation of the residuals, relative to the expected one.
  double scale() {
    const auto middle = sizes_.begin() + std::ptrdiff_t(sizes_.size() / 2);
    std::nth_element(sizes_.begin(), middle, sizes_.end());
    return std::max(kLeastScale, 1.4826 * double(*middle));
  }

  GainNormal normal(std::size_t view, float scale) const {
    return by_eye_ ? normal_of<6>(view, scale) : normal_of<3>(view, scale);
  }

  // Drift of the map where the features are.
  double drift() const {
    double all = 0, sum = 0;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      if (!(residuals_[i] == residuals_[i])) continue;
      const double deviation = double(seen_[i].inverse_deviation);
      const double weight = double(glm::dot(seen_[i].axis, seen_[i].axis)) * deviation * deviation;
      all += weight, sum += weight * double(seen_[i].feature->drift);
    }
    return all > 0 ? sum / all : 0;
  }

  // Notes which features did not agree.
  void note(double scale) const {
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      if (!(residuals_[i] == residuals_[i])) continue;
      const bool agrees = std::abs(double(residuals_[i])) < double(kTukey) * scale;
      seen_[i].feature->missed = agrees ? 0 : seen_[i].feature->missed + 1;
    }
  }

  // Share of what was read, by its weight in the fit, that agrees.
  double agreeing(double scale) const {
    double all = 0, good = 0;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      if (!(residuals_[i] == residuals_[i])) continue;
      const double weight = double(glm::length(seen_[i].axis) * seen_[i].inverse_deviation);
      all += weight;
      if (std::abs(double(residuals_[i])) < 3 * scale) good += weight;
    }
    return all > 0 ? good / all : 0;
  }

 private:
  template <int Count>
  GainNormal normal_of(std::size_t view, float scale) const {
    constexpr int kAll = Count + 1;  // and the gain
    const float cut = kTukey * scale, inverse = 1 / (cut * cut);
    float sums[kAll * (kAll + 1) / 2 + kAll] = {};
    for (std::size_t i = begin_[view]; i < begin_[view + 1]; ++i) {
      const float r = residuals_[i];
      const float t = 1 - r * r * inverse;
      if (!(t > 0)) continue;
      const float deviation = seen_[i].inverse_deviation, weight = t * t;
      float j[kAll];
      for (int a = 0; a < 3; ++a) j[a] = -seen_[i].axis[a] * deviation;
      for (int a = 3; a < Count; ++a) j[a] = -seen_[i].eye_axis[a - 3] * deviation;
      j[Count] = deviation;
      int k = 0;
      for (int a = 0; a < kAll; ++a)
        for (int b = 0; b <= a; ++b) sums[k++] += weight * j[a] * j[b];
      for (int a = 0; a < kAll; ++a) sums[k++] += weight * j[a] * r;
    }
    GainNormal n{{Count}};
    int k = 0;
    for (std::size_t a = 0; a < Count; ++a)
      for (std::size_t b = 0; b <= a; ++b) n.own.at(a, b) = n.own.at(b, a) = double(sums[k++]);
    for (std::size_t a = 0; a < Count; ++a) n.by_gain[a] = double(sums[k++]);
    n.gain = double(sums[k++]);
    for (std::size_t a = 0; a < Count; ++a) n.own.b[a] = double(sums[k++]);
    n.gain_b = double(sums[k++]);
    return n;
  }

  const MapFeatures& map_;
  const PictureFeatures& fine_;
  std::span<const MapView> views_;
  int level_;
  bool by_eye_;
  const AlignmentOptions& options_;
  std::vector<Candidate> scratch_;
  std::vector<Seen> seen_;
  std::vector<std::size_t> begin_;  // of the pictures
  std::vector<float> residuals_, sizes_;
};

}  // namespace

std::optional<Alignment> align_rotation(const MapFeatures& map, const PictureFeatures& fine,
                                        std::span<const MapView> given, const glm::dmat3& start,
                                        const RotationPrior& prior,
                                        const AlignmentOptions& options) {
  check(given.size() <= kMostViews, "an alignment is of ", kMostViews, " pictures at most, got ",
        given.size());
  Alignment out;
  out.rotation = start;
  LogGains log_gains{};
  const bool by_eye = prior.place_information.has_value();
  std::array<MapView, kMostViews> moved_views;
  std::copy(given.begin(), given.end(), moved_views.begin());
  const std::span views = std::span(moved_views).first(given.size());
  // Of rotation = prior.rotation · exp([from_prior]×), to first order.
  glm::dvec3 from_prior = rotation_vector(glm::transpose(prior.rotation) * start);
  for (int k = options.coarsest; k >= 0; --k) {
    Level level(map, fine, views, k, by_eye, options);
    level.project(out.rotation);
    Step step{};  // since features were projected
    const auto move = [&] {
      out.rotation = out.rotation * rotation_from_vector(turn_of(step));
      from_prior += turn_of(step), out.moved += shift_of(step);
      for (MapView& view : views) view.eye += shift_of(step);
      step = {};
    };
    std::size_t count = level.read(step, log_gains);
    if (count < kFewest) {
      if (k == 0) return std::nullopt;
      continue;
    }
    double scale = level.scale();
    double s2 = 0;  // divides what features tell
    std::array<GainNormal, kMostViews> normals;
    // What the pictures tell, with what is known of their gains, of the rotation and of the place.
    const auto added_up = [&] {
      s2 = scale * scale / options.independent;
      const double known = s2 / (options.gain_deviation * options.gain_deviation);
      Normal all{by_eye ? kUnknowns : std::size_t{3}};
      all.add_prior(0, s2 * prior.information, from_prior + turn_of(step));
      if (by_eye) all.add_prior(3, s2 * *prior.place_information, out.moved + shift_of(step));
      for (std::size_t v = 0; v < views.size(); ++v) {
        normals[v] = level.normal(v, float(scale));
        normals[v].gain += known, normals[v].gain_b -= known * log_gains[v];
        all.add(normals[v].without_gain());
      }
      return all;
    };
    for (int round = 0; round < options.rounds; ++round) {
      const Normal n = added_up();
      Step next{};
      if (!n.solve(next)) return std::nullopt;
      for (std::size_t i = 0; i < n.count; ++i) step[i] += next[i];
      for (std::size_t v = 0; v < views.size(); ++v) log_gains[v] += normals[v].gain_step(next);
      if (glm::length(turn_of(step)) > double(kRelinearise) ||
          glm::length(shift_of(step)) > double(kRelinearise)) {
        move();
        level.project(out.rotation);
      }
      count = level.read(step, log_gains);
      if (count < kFewest) return std::nullopt;
      scale = level.scale();
      if (glm::length(turn_of(next)) < double(kDone) && glm::length(shift_of(next)) < double(kDone))
        break;
    }
    move();
    if (k > 0) continue;
    const Normal all = added_up();
    const glm::dmat3 turn = all.block(0, 0) / s2;
    out.information = turn;
    if (by_eye) {  // each without knowing the other (Schur)
      const glm::dmat3 place = all.block(3, 3) / s2, both = all.block(0, 3) / s2;
      out.information -= both * glm::inverse(place) * glm::transpose(both);
      out.place_covariance = glm::inverse(place - glm::transpose(both) * glm::inverse(turn) * both);
    }
    out.residual = scale, out.features = int(count), out.agreeing = level.agreeing(scale);
    out.drift = level.drift();
    if (options.note) level.note(scale);
  }
  for (std::size_t v = 0; v < given.size(); ++v) out.gains[v] = std::exp(log_gains[v]);
  return out;
}

}  // namespace fastibl
