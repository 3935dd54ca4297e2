#include "fastibl/render/measure_errors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <functional>
#include <optional>
#include <utility>

#include "fastibl/lighting/find_near_lights.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/render/sample_shares.h"
#include "fastibl/render/true_light.h"
#include "fastibl/render/true_near.h"
#include "fastibl/render/true_plane.h"
#include "fastibl/shading/sample_cells.h"
#include "fastibl/shading/shade.h"
#include "fastibl/shadow/mesh_shadow.h"
#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {
namespace {

using Colours = std::vector<glm::vec3>;

// Of the object's median pixel in the picture, at most, as a share of white: on a dark floor a
// picture is exposed for the object.
constexpr float kObjectLevel = 0.7f;
// Of the bounce's own size. It also takes the plane to be even, which is judged by itself.
constexpr float kBounceError = 0.06f;
// Error of rays that start once per triangle's part of a pixel, and so miss edges within it, by the
// object's mean colour: here each sample has its own rays. By vertex, what is hidden is even over a
// pixel.
constexpr double kWithinPixel = 0.012;
constexpr float kFallbackAlbedo = 0.5f;  // of the plane where the map is black below the horizon

void subtract(Colours& from, const Colours& what) {
  for (std::size_t i = 0; i < from.size(); ++i) from[i] -= what[i];
}

double square(double x) { return x * x; }
double square(glm::vec3 difference) { return double(glm::dot(difference, difference)) / 3; }

struct Judged {
  const SceneSamples& samples;
  const Material& material;
  TrueLight truth;
  Colours emission, diffuse_factor, glossy_factor;  // of the material, under light of 1
  PlaneTruth plane;
  glm::vec3 plane_radiance{0};
  float white = 0;
  double object_weight = 0, plane_weight = 0;  // they turn errors into those of the whole picture

  glm::vec3 cut(glm::vec3 colour) const { return glm::min(colour, glm::vec3(white)); }
  glm::vec3 true_colour(std::size_t i) const {
    return emission[i] + diffuse_factor[i] * (truth.irradiance[i] - truth.lost[i]) / kPi +
           glossy_factor[i] * truth.lobe[i];
  }
  // Colours of pixels, from those of their samples. Where samples leave a part free, the plane
  // shows.
  template <typename Colour>
  Colours pixels(Colour&& colour) const {
    Colours result;
    result.reserve(samples.pixels.size());
    for (std::size_t p = 0; p + 1 < samples.pixels.size(); ++p) {
      const std::size_t first = samples.pixels[p], last = samples.pixels[p + 1];
      glm::vec3 sum = (1 - samples.part * float(last - first)) * plane_radiance;
      for (std::size_t i = first; i < last; ++i) sum += samples.part * colour(i);
      result.push_back(cut(sum));
    }
    return result;
  }
  Colours true_pixels() const {
    return pixels([this](std::size_t i) { return true_colour(i); });
  }
};

void weigh(Judged& j) {
  const Colours pixels = j.true_pixels();
  const std::size_t count = pixels.size();
  double object = 0, plane = 0;
  for (const glm::vec3& c : pixels) object += double(c.x + c.y + c.z) / 3 / double(count);
  double beside = 0;
  for (const std::size_t p : j.plane.counted) {
    const glm::vec3 c = j.cut(j.plane_radiance * (j.plane.ratio[p] + j.plane.added[p]));
    plane += double(c.x + c.y + c.z) / 3 * j.samples.plane_areas[p];
    beside += j.samples.plane_areas[p];
  }
  const double own = j.samples.object_area, all = own + beside;
  const double mean = (own * object + plane) / std::max(all, 1e-30);
  if (!(mean > 0)) return;
  j.object_weight = own / all / (mean * mean) / double(count);
  j.plane_weight = 1 / all / (mean * mean);
}

// The mean of the channels of the median pixel; 0 without pixels.
float middle_level(const Colours& pixels) {
  std::vector<float> levels;
  for (const glm::vec3& c : pixels) levels.push_back((c.x + c.y + c.z) / 3);
  if (levels.empty()) return 0;
  const auto middle = levels.begin() + std::ptrdiff_t(levels.size() / 2);
  std::nth_element(levels.begin(), middle, levels.end());
  return *middle;
}

// The share of the plane's light that a shadow leaves, at the places of the samples.
struct PlaneRatios {
  Colours known, close;
};

Colours diffuse_colours(const Judged& j, const Irradiance& irradiance) {
  Colours result;
  for (std::size_t i = 0; i < j.samples.seen; ++i)
    result.push_back(j.diffuse_factor[i] * evaluate(irradiance, j.samples.surface[i].normal) / kPi);
  return result;
}

// What four samples leave of a pixel, by two halves of them, each with the pixel's middle as its
// own: the variance of their mean is a quarter of the squared difference.
double sampling_error(const Judged& j) {
  constexpr bool kFirst[kSamples] = {true, false, false, true};
  double sum = 0;
  for (std::size_t p = 0; p + 1 < j.samples.pixels.size(); ++p) {
    glm::vec3 halves[2] = {j.plane_radiance, j.plane_radiance};
    for (std::size_t i = j.samples.pixels[p]; i < j.samples.pixels[p + 1]; ++i)
      halves[kFirst[j.samples.surface[i].place]] +=
          2 * j.samples.part * (j.true_colour(i) - j.plane_radiance);
    sum += square(j.cut(halves[0]) - j.cut(halves[1])) / 4;
  }
  return sum * j.object_weight;
}

void judge_object(const Judged& j, const std::vector<Colours>& diffuse,
                  const std::vector<Colours>& glossy,
                  const std::vector<std::vector<glm::vec4>>& shares, MeasuredErrors& errors) {
  const Candidates& c = errors.candidates;
  const Colours truth = j.true_pixels();
  const std::size_t count = truth.size();
  double mean = 0;
  for (const glm::vec3& t : truth) mean += double(t.x + t.y + t.z) / 3 / double(count);
  const auto within_pixels = [&](SelfShadowMethod method) {
    return traces_rays(method) ? square(kWithinPixel * mean) : 0.0;
  };
  const auto view_of = [&](std::size_t pixel) {
    return std::size_t(j.samples.surface[j.samples.pixels[pixel]].view);
  };
  std::array<double, SceneSamples::kViews> seen{};
  for (std::size_t p = 0; p < count; ++p) seen[view_of(p)] += 1;
  // Part of the picture's error squared: over all views, and in the worst.
  const auto off = [&](auto&& colour, double within_pixel) {
    const Colours made = j.pixels(colour);
    std::array<double, SceneSamples::kViews> sums{};
    for (std::size_t p = 0; p < count; ++p) sums[view_of(p)] += square(made[p] - truth[p]);
    ErrorAlone result;
    for (std::size_t v = 0; v < sums.size(); ++v) {
      if (!(seen[v] > 0)) continue;
      sums[v] += within_pixel * seen[v];
      result.mean += sums[v] * j.object_weight;
      result.worst = std::max(result.worst, sums[v] / seen[v] * double(count) * j.object_weight);
    }
    return result;
  };
  for (const Colours& d : diffuse)
    for (const Colours& g : glossy)
      for (std::size_t m = 0; m < shares.size(); ++m)
        for (const BounceMethod b : c.bounce) {
          const std::vector<glm::vec4>& s = shares[m];
          const double within_pixel = within_pixels(c.self_shadow[m]);
          const float kept = b == BounceMethod::none ? 0.0f : 1 - kBounceError;
          const ErrorAlone all = off(
              [&](std::size_t i) {
                const glm::vec3 lost = j.diffuse_factor[i] * j.truth.lost_of_even[i] * (kept / kPi);
                return j.emission[i] + glm::max(d[i] * glm::vec3(s[i]) - lost, glm::vec3(0)) +
                       g[i] * glossy_share(s[i], j.material);
              },
              within_pixel);
          errors.object.push_back(all.mean);
          errors.object_worst.push_back(all.worst);
        }
  // Error of each step alone, the others as they truly are.
  const auto alone = [&](auto&& colour) { return off(colour, 0); };
  const auto share = [](glm::vec3 part, glm::vec3 whole) {
    glm::vec3 result(1);
    for (int k = 0; k < 3; ++k)
      if (whole[k] > 0) result[k] = part[k] / whole[k];
    return result;
  };
  for (const Colours& d : diffuse)
    errors.diffuse.push_back(alone([&](std::size_t i) {
      const glm::vec3 right = j.diffuse_factor[i] * j.truth.open_irradiance[i] / kPi;
      return j.true_colour(i) +
             (d[i] - right) * share(j.truth.irradiance[i], j.truth.open_irradiance[i]);
    }));
  for (const Colours& g : glossy)
    errors.glossy.push_back(alone([&](std::size_t i) {
      const glm::vec3 right = j.glossy_factor[i] * j.truth.open_lobe[i];
      return j.true_colour(i) + (g[i] - right) * share(j.truth.lobe[i], j.truth.open_lobe[i]);
    }));
  for (std::size_t m = 0; m < shares.size(); ++m) {
    const std::vector<glm::vec4>& s = shares[m];
    errors.self_shadow.push_back(off(
        [&](std::size_t i) {
          return j.true_colour(i) +
                 j.diffuse_factor[i] / kPi *
                     (j.truth.open_irradiance[i] * glm::vec3(s[i]) - j.truth.irradiance[i]) +
                 j.glossy_factor[i] *
                     (j.truth.open_lobe[i] * glossy_share(s[i], j.material) - j.truth.lobe[i]);
        },
        within_pixels(c.self_shadow[m])));
  }
  for (const BounceMethod b : c.bounce)
    errors.bounce.push_back(alone([&](std::size_t i) {
      const float kept = b == BounceMethod::none ? 0.0f : 1 - kBounceError;
      const glm::vec3 missing = j.truth.lost[i] - kept * j.truth.lost_of_even[i];
      return j.true_colour(i) + j.diffuse_factor[i] * missing / kPi;
    }));
}

// Judges by the places whose truth is known. Few of them lie where shadows have their edges, so the
// difference of a shadow from the finest one, the last, is taken from the close places instead.
void judge_plane(const Judged& j, const std::vector<PlaneRatios>& ratios, MeasuredErrors& errors) {
  const Candidates& c = errors.candidates;
  // Part of the picture's error squared: the plane's gain at some places against a right one.
  const auto off = [&](const std::vector<std::size_t>& places, const std::vector<double>& areas,
                       auto&& gain, auto&& right) {
    double sum = 0;
    for (const std::size_t p : places)
      sum +=
          areas[p] * square(j.cut(j.plane_radiance * gain(p)) - j.cut(j.plane_radiance * right(p)));
    return sum * j.plane_weight;
  };
  const auto error = [&](const Colours& ratio, float missing) {
    return off(
        j.plane.counted, j.samples.plane_areas,
        [&](std::size_t p) { return ratio[p] + j.plane.added[p] * (1 - missing); },
        [&](std::size_t p) { return j.plane.ratio[p] + j.plane.added[p]; });
  };
  const auto missing = [](BounceMethod b) { return b == BounceMethod::none ? 1.0f : kBounceError; };
  const PlaneRatios& finest = ratios.back();
  std::vector<std::size_t> close;
  for (std::size_t p = 0; p < finest.close.size(); ++p)
    if (shows_on_plane(finest.close[p])) close.push_back(p);
  for (const PlaneRatios& r : ratios) {
    const auto from_finest = [&](const std::vector<std::size_t>& places,
                                 const std::vector<double>& areas, Colours PlaneRatios::*ratio) {
      return off(
          places, areas, [&](std::size_t p) { return (r.*ratio)[p]; },
          [&](std::size_t p) { return (finest.*ratio)[p]; });
    };
    const double closer = from_finest(close, j.samples.close_areas, &PlaneRatios::close) -
                          from_finest(j.plane.counted, j.samples.plane_areas, &PlaneRatios::known);
    const auto with = [&](double known) { return std::max(known + closer, 0.0); };
    for (const BounceMethod b : c.bounce) errors.plane.push_back(with(error(r.known, missing(b))));
    const double alone = with(error(r.known, 0));
    errors.shadow.push_back({alone, alone});
  }
  for (std::size_t b = 0; b < c.bounce.size(); ++b) {
    const double plane = error(j.plane.ratio, missing(c.bounce[b]));
    errors.bounce[b].mean += plane, errors.bounce[b].worst += plane;
  }
}

}  // namespace

LightToJudge LightToJudge::of(const std::shared_ptr<const Environment>& environment) {
  return {{environment, &environment->radiance}, find_near_lights(*environment)};
}

struct ErrorMeasurement::Work {
  const SceneSamples& samples;
  const std::shared_ptr<const CubeMap> map;
  NearLights near_lights;  // in the samples' frame
  const Material material;
  const Normalization normalization;
  const Candidates candidates;
  Scene standing;  // what a shadow reads of the scene, placed where it is judged
  std::deque<std::function<void()>> steps;
  MeasuredErrors errors;

  std::optional<SampleFlux> flux;
  std::optional<BrightPieces> bright;
  std::optional<NearTruth> near_truth;
  std::optional<Judged> judged;
  LightingOptions plain;
  Lighting reference;                        // of the finest irradiance
  std::shared_ptr<const GlossyChain> chain;  // of the last method that reads one
  std::shared_ptr<const CubeMap> near_map;   // what near lights send
  std::vector<PlaneRatios> ratios;           // by shadow
  bool fine = true;                          // false: the last cast drew no fine map
  std::vector<Colours> diffuse, glossy;
  std::optional<SampleShares> maker;
  std::vector<std::vector<glm::vec4>> shares;

  Work(const Scene& scene, const SceneSamples& at, const LightToJudge& light, Normalization scale,
       const Candidates& all)
      : samples(at),
        map(light.map),
        near_lights(light.near_lights),
        material(scene.material),
        normalization(scale),
        candidates(all),
        ratios(all.shadow.size()) {
    standing.spheres = scene.spheres, standing.baked_shadow = scene.baked_shadow;
    standing.marker_from_object.rotation = glm::dmat3(at.turned);
    standing.marker_from_object.translation = {0, 0, at.lifted};
    if (scene.baked_shadow && !scene.baked_shadow->motion(standing.marker_from_object))
      standing.given = scene.given ? scene.given : std::make_shared<const Mesh>(scene.mesh);
    near_lights.centre -= shift_of(scene, at);
    maker.emplace(samples, scene, reference);
  }

  void find_truth() {
    flux.emplace(*map, samples);
    bright.emplace(*map, samples, *flux);
    near_truth.emplace(near_lights, *bright);
    TrueLight truth = true_light(*map, samples, *flux, *bright, *near_truth, material.lobe());
    judged.emplace(Judged{samples, material, std::move(truth), {}, {}, {}, {}});
  }

  void read_material() {
    Judged& j = *judged;
    plain.diffuse = DiffuseMethod::sh9, plain.glossy = GlossyMethod::mip;
    plain.normalization = normalization;
    plain.measure_error = plain.chain = false;
    const std::vector<glm::vec3> ones(6, glm::vec3(1));
    const Lighting white = fit_lighting(std::make_shared<const CubeMap>(1, ones), plain);
    const std::size_t every = samples.surface.size();
    j.emission = sample_colours(samples, every, material, white, glm::vec4(0));
    j.diffuse_factor = sample_colours(samples, every, material, white, {1, 1, 1, 0});
    j.glossy_factor = sample_colours(samples, samples.seen, material, white, {0, 0, 0, 1});
    subtract(j.diffuse_factor, j.emission), subtract(j.glossy_factor, j.emission);
    LightingOptions finest = plain;
    finest.diffuse = DiffuseMethod::irradiance_cube;
    reference = fit_lighting(map, finest);
    reference.near_lights = near_lights;
  }

  // From the last on, and before the object: light that the plane lacks, the object lacks too.
  void cast_all() {
    for (std::size_t k = candidates.shadow.size(); k-- > 0;) cast(k);
  }

  void cast(std::size_t k) {
    const ShadowCandidate& s = candidates.shadow[k];
    if (!fine && s.method == ShadowMethod::mesh &&
        s.settings.directions == candidates.shadow[k + 1].settings.directions) {
      ratios[k] = ratios[k + 1];  // a finer map was asked for, but not drawn
      return;
    }
    SceneShadow caster;
    ShadowOptions options;
    options.method = s.method, options.settings = s.settings;
    const ShadowMap shadow =
        caster.cast(*map, reference.plane_irradiance, standing, options, near_lights);
    ratios[k].known.resize(samples.plane.size());
    ratios[k].close.resize(samples.close_plane.size());
    shadow.sample(samples.plane, ratios[k].known);
    shadow.sample(samples.close_plane, ratios[k].close);
    if (k + 1 == candidates.shadow.size())
      add_lost(samples, *flux, shadow, judged->truth);  // the last is the finest
    fine = s.method != ShadowMethod::mesh || !shadow.fine.empty();
  }

  void find_plane() {
    const Judged& j = *judged;
    Colours sent;
    for (std::size_t i = 0; i < samples.surface.size(); ++i)
      sent.push_back(j.diffuse_factor[i] * (j.truth.irradiance[i] - j.truth.lost[i]) +
                     kPi * j.emission[i]);
    judged->plane = plane_truth(samples, *flux, *bright, *near_truth, sent);
  }

  // False if there is nothing to compare.
  bool weigh_picture() {
    Judged& j = *judged;
    j.plane_radiance = map->sample({0, 0, -1}, float(map->level_count()) - 3);
    if (!(j.plane_radiance.x + j.plane_radiance.y + j.plane_radiance.z > 0))
      j.plane_radiance = kFallbackAlbedo / kPi * flux->plane;
    j.white = std::numeric_limits<float>::infinity();  // nothing is cut yet
    const float object = middle_level(j.true_pixels());
    j.white = (j.plane_radiance.x + j.plane_radiance.y + j.plane_radiance.z) / 3 / kPlaneLevel;
    if (std::isfinite(object)) j.white = std::max(j.white, object / kObjectLevel);
    if (j.white > 0) weigh(j);
    return j.object_weight > 0;
  }

  void fit_diffuse() {
    for (const DiffuseCandidate& d : candidates.diffuse) {
      LightingOptions options = plain;
      options.diffuse = d.method, options.diffuse_settings = d.settings;
      const bool reads = material.reads_irradiance();
      diffuse.push_back(diffuse_colours(
          *judged, reads ? fit_lighting(map, options).irradiance : reference.irradiance));
    }
  }

  void read_glossy(const GlossyCandidate& g) {
    if (!material.lobe()) {
      glossy.emplace_back(samples.seen, glm::vec3(0));
      return;
    }
    LightingOptions options;
    options.glossy = g.method, options.glossy_settings = g.settings;
    options.normalization = normalization;
    options.irradiance = options.chain = false;
    Lighting lighting = fit_lighting(map, options);
    lighting.irradiance = reference.irradiance, lighting.near_lights = near_lights;
    fit_near_radiance(lighting, near_map);
    if (lighting.near_radiance) near_map = lighting.near_radiance;
    if (reads_chain(lighting.glossy)) fit_chain(lighting, chain), chain = lighting.chain;
    glossy.push_back(sample_colours(samples, samples.seen, material, lighting, {0, 0, 0, 1}));
    subtract(glossy.back(), judged->emission);
  }

  void share_all() {
    for (const SelfShadowMethod method : candidates.self_shadow)
      shares.push_back(maker->of(method));
    errors.rays = maker->rays();
  }

  void judge() {
    errors.candidates = candidates;
    if (samples.part < 1) errors.sampling = sampling_error(*judged);
    judge_object(*judged, diffuse, glossy, shares, errors);
    judge_plane(*judged, ratios, errors);
  }
};

ErrorMeasurement::ErrorMeasurement(const Scene& scene, const SceneSamples* at,
                                   const LightToJudge& light, const Methods& asked,
                                   const Candidates& candidates, bool cast_shadow) {
  if (!at || at->empty() || !light.map || light.map->size() == 0) return;
  work_ = std::make_unique<Work>(scene, *at, light, asked.normalization, candidates);
  Work* const work = work_.get();
  std::deque<std::function<void()>>& steps = work->steps;
  // What takes far less than a millisecond goes with its neighbour.
  const bool shadow = cast_shadow && scene.casts_shadow();
  steps = {[=] { work->find_truth(), work->read_material(); }};
  if (shadow) steps.push_back([=] { work->cast_all(); });
  steps.push_back([=] {
    if (shadow) work->find_plane();
    if (work->weigh_picture())
      work->fit_diffuse();
    else
      work->steps.clear();
  });
  for (const GlossyCandidate& g : candidates.glossy) steps.push_back([=] { work->read_glossy(g); });
  steps.push_back([=] { work->share_all(); });
  steps.push_back([=] { work->judge(); });
}
ErrorMeasurement::ErrorMeasurement(ErrorMeasurement&&) noexcept = default;
ErrorMeasurement& ErrorMeasurement::operator=(ErrorMeasurement&&) noexcept = default;
ErrorMeasurement::~ErrorMeasurement() = default;

bool ErrorMeasurement::done() const { return !work_ || work_->steps.empty(); }

void ErrorMeasurement::step() {
  if (done()) return;
  const auto next = work_->steps.front();
  work_->steps.pop_front();
  next();
}

MeasuredErrors ErrorMeasurement::errors() const { return work_ ? work_->errors : MeasuredErrors(); }

MeasuredErrors measure_errors(const Scene& scene, const SceneSamples* at, const LightToJudge& light,
                              const Methods& asked, const Candidates& candidates,
                              bool cast_shadow) {
  ErrorMeasurement measurement(scene, at, light, asked, candidates, cast_shadow);
  while (!measurement.done()) measurement.step();
  return measurement.errors();
}

}  // namespace fastibl
