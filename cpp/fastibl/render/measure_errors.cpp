#include "fastibl/render/measure_errors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <utility>

#include "fastibl/core/parallel.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/render/true_light.h"
#include "fastibl/scene/response.h"
#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/self_shadow.h"
#include "fastibl/shading/shade.h"
#include "fastibl/shading/traced_shares.h"
#include "fastibl/shadow/mesh_shadow.h"
#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {
namespace {

using Colours = std::vector<glm::vec3>;

constexpr float kPlaneLevel = 0.35f;  // of the plane in the picture, as a share of white
// The same of the object's median pixel, at most: on a dark floor a picture is exposed for the
// object.
constexpr float kObjectLevel = 0.7f;
// Of the bounce's own size. It also takes the plane to be even, which is judged by itself.
constexpr float kBounceError = 0.06f;
// Error of rays that start once per triangle's part of a pixel, and so miss edges within it, by the
// object's mean colour: here each sample has its own rays. By vertex, what is hidden is even over a
// pixel.
constexpr double kWithinPixel = 0.012;
constexpr float kFallbackAlbedo = 0.5f;  // of the plane where the map is black below the horizon

// Colours of the first `count` samples under some light: with all of their diffuse light and
// nothing glossy, or the other way round.
Colours colours(const SceneSamples& samples, std::size_t count, const Material& material,
                const Lighting& lighting, glm::vec4 share) {
  std::vector<Fragment> fragments;
  for (const SceneSamples::Surface& s : std::span(samples.surface).first(count)) {
    Fragment& f = fragments.emplace_back();
    f.coverage = 1, f.position = s.position, f.normal = s.normal, f.share = share;
    f.tangent = s.tangent, f.uv = s.uv, f.color = s.color;
    f.uv_dx = {0.02f, 0}, f.uv_dy = {0, 0.02f};  // about a pixel's part of a texture
  }
  Colours result(count);
  const SurfaceShading shading(material, lighting);
  // The samples of one eye at a time.
  for (std::size_t first = 0, last; first < count; first = last) {
    const int view = samples.surface[first].view;
    for (last = first; last < count && samples.surface[last].view == view;) ++last;
    shading(std::span(fragments).subspan(first, last - first), samples.eyes[std::size_t(view)],
            std::span(result).subspan(first, last - first));
  }
  return result;
}

void subtract(Colours& from, const Colours& what) {
  for (std::size_t i = 0; i < from.size(); ++i) from[i] -= what[i];
}

// The share of its light that reaches each sample, by P_V.
std::vector<glm::vec4> ambient_shares(const SceneSamples& samples) {
  std::vector<glm::vec4> result;
  for (const SceneSamples::Surface& s : std::span(samples.surface).first(samples.seen)) {
    float open = 0;
    for (int k = 0; k < 3; ++k) open += s.weights[k] * samples.openness[std::size_t(s.corners[k])];
    result.emplace_back(glm::vec3(open), 1);
  }
  return result;
}

// Shares by the directions that are free.
std::vector<glm::vec4> transfer_shares(const SceneSamples& samples, const CubeMap& map,
                                       const Irradiance& irradiance, const Material& material) {
  std::vector<glm::vec4> result(samples.seen, glm::vec4(1));
  if (samples.visibility.blocks_nothing()) return result;
  std::vector<glm::vec4> by_vertex(samples.vertices.size(), glm::vec4(1));
  CellLight light;
  light.update(map, glm::transpose(samples.turned), samples.visibility.size);
  if (material.reads_irradiance())
    diffuse_shares(samples.visibility, light, irradiance, samples.normals, samples.turned,
                   by_vertex);
  const std::optional<LobeShape> lobe = material.lobe();
  for (std::size_t v = 0; v < samples.picture_count; ++v) {
    const glm::vec3 lifted(0, 0, samples.lifted);
    if (lobe)
      glossy_shares(samples.visibility, light, *lobe, samples.vertices, samples.normals,
                    glm::transpose(samples.turned) * (samples.eyes[v] - lifted), by_vertex);
    for (std::size_t i = 0; i < result.size(); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      if (s.view != int(v)) continue;
      result[i] = glm::vec4(0);
      for (int k = 0; k < 3; ++k) result[i] += s.weights[k] * by_vertex[std::size_t(s.corners[k])];
    }
  }
  return result;
}

// Shares of glossy light by each sample's lobe, and by what is hidden from the corners around it.
void share_by_pixel(const SceneSamples& samples, const CubeMap& map, const Material& material,
                    std::vector<glm::vec4>& shares) {
  const std::optional<LobeShape> lobe = material.lobe();
  if (!lobe || samples.visibility.blocks_nothing()) return;
  CellLight light;
  light.update(map, glm::transpose(samples.turned), samples.visibility.size);
  const LobeCells cells(light, *lobe);
  const glm::mat3 mesh_from_marker = glm::transpose(samples.turned);
  std::array<HiddenCells, 3> hidden{HiddenCells(cells.size()), HiddenCells(cells.size()),
                                    HiddenCells(cells.size())};
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (!is_touched(shares[i].w)) continue;
    const SceneSamples::Surface& s = samples.surface[i];
    for (std::size_t k = 0; k < 3; ++k)
      hidden[k].set(samples.visibility.edges_of(std::size_t(s.corners[k])),
                    samples.visibility.size);
    shares[i].w =
        cells.share(mesh_from_marker * s.normal, mesh_from_marker * s.to_eye,
                    {{hidden[0].masks(), hidden[1].masks(), hidden[2].masks()}, s.weights});
  }
}

// Traces the shares, where the object hides anything.
void trace_light(const SceneSamples& samples, const CubeMap& map, const Material& material,
                 std::vector<glm::vec4>& shares) {
  if (samples.visibility.blocks_nothing()) return;
  const TracedLight light(*samples.bvh, map, glm::mat3(1), material.reads_irradiance(),
                          material.lobe());
  parallel_for(int(shares.size()), 16, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      const SceneSamples::Surface& s = samples.surface[std::size_t(i)];
      shares[std::size_t(i)] = light.shares(s.start, s.normal, s.to_eye);
    }
  });
}

// What is true on the plane, and which places count.
struct PlaneTruth {
  Colours ratio, added;  // the shadow's; the object's light there, divided by the plane's own
  std::vector<std::size_t> counted;
};

// The pieces' light that the object hides from a place. hidden: 1 for directions hidden there.
glm::vec3 hidden_light(const BrightPieces& bright, const SceneSamples& samples, glm::vec2 place,
                       const std::uint8_t* hidden) {
  const glm::vec3 from(place, samples.above), to = samples.centre - from;
  const float distance = glm::length(to);
  const float cosine = distance > samples.radius
                           ? std::sqrt(1 - samples.radius * samples.radius / (distance * distance))
                           : -1;
  glm::vec3 lost(0);
  std::vector<std::size_t> asked;
  constexpr std::size_t kCount = BrightPieces::kCount;
  for (std::size_t b = 0; b < bright.cut_texels.size(); ++b) {
    const std::size_t k = bright.cut_texels[b];
    const bool same = same_around(hidden, k);
    if (same && !hidden[k]) continue;
    for (std::size_t i = b * kCount; i < (b + 1) * kCount; ++i) {
      if (!(bright.z[i] > 0)) continue;
      if (same)
        lost += bright.z[i] * bright.flux(i);
      else if (glm::dot(bright.direction(i), to) >= cosine * distance)
        asked.push_back(i);
    }
  }
  if (asked.empty()) return lost;
  DirectionSet set(int(asked.size()));
  for (std::size_t i = 0; i < asked.size(); ++i) set.set(int(i), bright.direction(asked[i]));
  std::vector<std::uint8_t> met(asked.size(), 0);
  samples.bvh->occluded(from, set, 0, met);
  for (std::size_t i = 0; i < asked.size(); ++i)
    if (met[i]) lost += bright.z[asked[i]] * bright.flux(asked[i]);
  return lost;
}

// Mean of the light `sent` by the samples, as it reaches a place on the plane; each sample is
// weighted by the form factor of the surface that it stands for. Where any of them sees the place,
// those do not count from which other parts of the object hide it: a cup's inside is dark.
glm::vec3 mean_received(const SceneSamples& samples, const Colours& sent, glm::vec2 place) {
  constexpr float kGrazing = 0.1f;
  constexpr std::size_t n = SceneSamples::kLevelSize;
  constexpr std::size_t kEnough = 1200;  // samples: as many as all views have
  const float near2 = 1e-4f * samples.radius * samples.radius;
  glm::vec3 sum(0), free_sum(0);
  float all = 0, all_free = 0;
  const std::size_t step = (sent.size() + kEnough - 1) / kEnough;
  for (std::size_t i = 0; i < sent.size(); i += step) {
    const SceneSamples::Surface& s = samples.surface[i];
    const glm::vec3 d = s.position - glm::vec3(place, 0);
    const float facing = -glm::dot(s.normal, d), distance2 = glm::dot(d, d) + near2;
    if (!(facing > 0 && d.z > 0)) continue;
    const float seen = std::max(glm::dot(s.normal, s.to_eye), kGrazing);
    const float part = facing * d.z / (seen * distance2 * distance2);
    sum += part * sent[i], all += part;
    const TexelPlace towards = texel_at(-d, int(n));
    const std::size_t k =
        (std::size_t(towards.face) * n + std::size_t(towards.y)) * n + std::size_t(towards.x);
    if (samples.free[i * samples.direction_count() + k])
      free_sum += part * sent[i], all_free += part;
  }
  return all_free > 0 ? free_sum / all_free : all > 0 ? sum / all : glm::vec3(0);
}

// Whether this factor on the plane's light changes the plane's picture by more than a code.
bool shows(glm::vec3 gain) {
  static const Response response;
  static const float bare = response.encode(kPlaneLevel);
  bool any = false;
  for (int c = 0; c < 3; ++c)
    any |= std::abs(response.encode(kPlaneLevel * gain[c]) - bare) > 1 / 255.0f;
  return any;
}

PlaneTruth plane_truth(const SceneSamples& samples, const SampleFlux& flux,
                       const BrightPieces& bright, const Colours& sent) {
  const std::size_t places = samples.plane.size();
  PlaneTruth truth{Colours(places, glm::vec3(1)), Colours(places, glm::vec3(0)), {}};
  std::vector<std::uint8_t> counts(places, 0);
  parallel_for(int(places), 16, [&](int begin, int end) {
    std::vector<std::uint8_t> hidden(samples.direction_count());
    for (std::size_t p = std::size_t(begin); p < std::size_t(end); ++p) {
      const auto directions =
          std::span(samples.hidden)
              .subspan(samples.plane_first[p], samples.plane_first[p + 1] - samples.plane_first[p]);
      std::fill(hidden.begin(), hidden.end(), std::uint8_t(0));
      for (const std::uint16_t k : directions) hidden[k] = 1;
      glm::vec3 lost = hidden_light(bright, samples, samples.plane[p], hidden.data());
      float factor = 0;
      for (const std::uint16_t k : directions) {
        const float z = samples.directions[k].z;
        if (!bright.cut[k]) lost += z * flux[k];
        factor += z * samples.solid_angles[k] / kPi;
      }
      const glm::vec3 light =
          factor > 0 ? factor * mean_received(samples, sent, samples.plane[p]) : glm::vec3(0);
      glm::vec3 &ratio = truth.ratio[p], &added = truth.added[p];
      for (int c = 0; c < 3; ++c) {
        if (flux.plane[c] > 0) {
          ratio[c] = std::max(1 - lost[c] / flux.plane[c], 0.0f);
          added[c] = light[c] / flux.plane[c];
        }
      }
      counts[p] = shows(ratio + added);
    }
  });
  for (std::size_t p = 0; p < places; ++p)
    if (counts[p]) truth.counted.push_back(p);
  return truth;
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

void judge_object(const Judged& j, const std::vector<Colours>& diffuse,
                  const std::vector<Colours>& glossy,
                  const std::vector<std::vector<glm::vec4>>& shares, MeasuredErrors& errors) {
  const Candidates& c = errors.candidates;
  const Colours truth = j.true_pixels();
  const std::size_t count = truth.size();
  double mean = 0;
  for (const glm::vec3& t : truth) mean += double(t.x + t.y + t.z) / 3 / double(count);
  const auto within_pixels = [&](SelfShadowMethod method) {
    return method == SelfShadowMethod::traced ? square(kWithinPixel * mean) : 0.0;
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
    if (shows(finest.close[p])) close.push_back(p);
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

struct ErrorMeasurement::Work {
  const SceneSamples& samples;
  const std::shared_ptr<const CubeMap> map;
  const Material material;
  const Normalization normalization;
  const Candidates candidates;
  Scene standing;  // what a shadow reads of the scene, placed where it is judged
  std::deque<std::function<void()>> steps;
  MeasuredErrors errors;

  std::optional<SampleFlux> flux;
  std::optional<BrightPieces> bright;
  std::optional<Judged> judged;
  LightingOptions plain;
  Lighting reference, last;         // of the finest irradiance; the one whose chain the next reads
  std::vector<PlaneRatios> ratios;  // by shadow
  bool fine = true;                 // false: the last cast drew no fine map
  std::vector<Colours> diffuse, glossy;
  std::vector<glm::vec4> transfer;
  std::vector<std::vector<glm::vec4>> shares;

  Work(const Scene& scene, const SceneSamples& at, std::shared_ptr<const CubeMap> light,
       Normalization scale, const Candidates& all)
      : samples(at),
        map(std::move(light)),
        material(scene.material),
        normalization(scale),
        candidates(all),
        ratios(all.shadow.size()) {
    standing.spheres = scene.spheres, standing.baked_shadow = scene.baked_shadow;
    standing.marker_from_object.rotation = glm::dmat3(at.turned);
    standing.marker_from_object.translation = {0, 0, at.lifted};
    if (scene.baked_shadow && !scene.baked_shadow->motion(standing.marker_from_object))
      standing.given = scene.given ? scene.given : std::make_shared<const Mesh>(scene.mesh);
  }

  void find_truth() {
    flux.emplace(*map, samples);
    bright.emplace(*map, samples, *flux);
    judged.emplace(Judged{
        samples, material, true_light(samples, *flux, *bright, material.lobe()), {}, {}, {}, {}});
  }

  void read_material() {
    Judged& j = *judged;
    plain.diffuse = DiffuseMethod::sh9, plain.glossy = GlossyMethod::mip;
    plain.normalization = normalization;
    plain.measure_error = plain.chain = false;
    const std::vector<glm::vec3> ones(6, glm::vec3(1));
    const Lighting white = fit_lighting(std::make_shared<const CubeMap>(1, ones), plain);
    const std::size_t every = samples.surface.size();
    j.emission = colours(samples, every, material, white, glm::vec4(0));
    j.diffuse_factor = colours(samples, every, material, white, {1, 1, 1, 0});
    j.glossy_factor = colours(samples, samples.seen, material, white, {0, 0, 0, 1});
    subtract(j.diffuse_factor, j.emission), subtract(j.glossy_factor, j.emission);
    LightingOptions finest = plain;
    finest.diffuse = DiffuseMethod::irradiance_cube;
    reference = fit_lighting(map, finest);
  }

  // From the last on, and before the object: light that the plane lacks, the object lacks too.
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
    const ShadowMap shadow = caster.cast(*map, reference.plane_irradiance, standing, options);
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
    judged->plane = plane_truth(samples, *flux, *bright, sent);
  }

  void weigh_picture() {
    Judged& j = *judged;
    j.plane_radiance = map->sample({0, 0, -1}, float(map->level_count()) - 3);
    if (!(j.plane_radiance.x + j.plane_radiance.y + j.plane_radiance.z > 0))
      j.plane_radiance = kFallbackAlbedo / kPi * flux->plane;
    j.white = std::numeric_limits<float>::infinity();  // nothing is cut yet
    const float object = middle_level(j.true_pixels());
    j.white = (j.plane_radiance.x + j.plane_radiance.y + j.plane_radiance.z) / 3 / kPlaneLevel;
    if (std::isfinite(object)) j.white = std::max(j.white, object / kObjectLevel);
    if (j.white > 0) weigh(j);
    if (!(j.object_weight > 0)) steps.clear();  // nothing to compare
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
    options.irradiance = false;
    Lighting lighting = fit_lighting(map, options, last.radiance ? &last : nullptr);
    lighting.irradiance = reference.irradiance;
    glossy.push_back(colours(samples, samples.seen, material, lighting, {0, 0, 0, 1}));
    subtract(glossy.back(), judged->emission);
    if (lighting.chain) last = std::move(lighting);
  }

  void share(SelfShadowMethod method) {
    if (method == SelfShadowMethod::none) {
      shares.emplace_back(samples.seen, glm::vec4(1));
    } else if (method == SelfShadowMethod::ambient) {
      shares.push_back(ambient_shares(samples));
    } else {
      if (transfer.empty())
        transfer = transfer_shares(samples, *map, reference.irradiance, material);
      shares.push_back(transfer);
      if (method == SelfShadowMethod::traced) trace_light(samples, *map, material, shares.back());
      if (method == SelfShadowMethod::pixel_transfer)
        share_by_pixel(samples, *map, material, shares.back());
    }
  }

  void judge() {
    errors.candidates = candidates;
    judge_object(*judged, diffuse, glossy, shares, errors);
    judge_plane(*judged, ratios, errors);
  }
};

ErrorMeasurement::ErrorMeasurement(const Scene& scene, const SceneSamples* at,
                                   std::shared_ptr<const CubeMap> map, const Methods& asked,
                                   const Candidates& candidates, bool cast_shadow) {
  if (!at || at->empty() || !map || map->size() == 0) return;
  work_ = std::make_unique<Work>(scene, *at, std::move(map), asked.normalization, candidates);
  Work* const work = work_.get();
  std::deque<std::function<void()>>& steps = work->steps;
  steps = {[=] { work->find_truth(); }, [=] { work->read_material(); }};
  if (cast_shadow && scene.casts_shadow()) {
    for (std::size_t k = candidates.shadow.size(); k-- > 0;)
      steps.push_back([=] { work->cast(k); });
    steps.push_back([=] { work->find_plane(); });
  }
  steps.push_back([=] { work->weigh_picture(); });
  steps.push_back([=] { work->fit_diffuse(); });
  for (const GlossyCandidate& g : candidates.glossy) steps.push_back([=] { work->read_glossy(g); });
  for (const SelfShadowMethod method : candidates.self_shadow)
    steps.push_back([=] { work->share(method); });
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

MeasuredErrors measure_errors(const Scene& scene, const SceneSamples* at,
                              const std::shared_ptr<const CubeMap>& map, const Methods& asked,
                              const Candidates& candidates, bool cast_shadow) {
  ErrorMeasurement measurement(scene, at, map, asked, candidates, cast_shadow);
  while (!measurement.done()) measurement.step();
  return measurement.errors();
}

}  // namespace fastibl
