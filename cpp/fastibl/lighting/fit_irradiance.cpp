#include "fastibl/lighting/fit_irradiance.h"

#include <cmath>

#include "fastibl/lighting/fit_lobes.h"
#include "fastibl/lighting/harmonic_sums.h"
#include "fastibl/lighting/irradiance_sums.h"

namespace fastibl {
namespace {

// The difference that a change of method leaves fades by this share of the light from map to map.
constexpr double kMostFade = 0.0004;
// It begins with no more than this share: where a method is given up because it is wrong by more
// under changed light, that error must not stay.
constexpr double kMostRest = 0.025;
constexpr int kFadeSize = 24;  // texels of the cube that the difference is added to
// The texels of this cube lie evenly between those of usual cubes, 8² to 32²: the error of a cube
// is told within 25 %. At 6² texels it was told too low by up to 2.2 times.
constexpr int kErrorSize = 9;

std::array<glm::vec3, 9> irradiance_polynomial(const std::array<glm::dvec3, 9>& sh) {
  // A_l of the clamped cosine (π, 2π/3, π/4) times the constant of each basis function.
  constexpr double pi = std::numbers::pi;
  constexpr double constant[9] = {
      0.28209479177387814 * pi,         0.48860251190291992 * 2 * pi / 3,
      0.48860251190291992 * 2 * pi / 3, 0.48860251190291992 * 2 * pi / 3,
      1.0925484305920792 * pi / 4,      1.0925484305920792 * pi / 4,
      0.31539156525252005 * pi / 4,     1.0925484305920792 * pi / 4,
      0.54627421529603959 * pi / 4};
  std::array<glm::vec3, 9> polynomial;
  for (std::size_t i = 0; i < 9; ++i) polynomial[i] = glm::vec3(sh[i] * constant[i]);
  return polynomial;
}

// Linear interpolation between texels h apart is wrong by h²/12 of the second derivative on average
// (at most by h²/8, always to the same side). Subtracting that from the texels leaves a third to a
// half of the error, still with one look-up.
CubeLevel for_interpolation(const CubeLevel& exact) {
  const int n = exact.size();
  CubeLevel result(n);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec3 around = exact.texel(f, x - 1, y) + exact.texel(f, x + 1, y) +
                                 exact.texel(f, x, y - 1) + exact.texel(f, x, y + 1);
        const glm::vec3 middle = exact.texel(f, x, y);
        result.texel(f, x, y) = glm::max(middle - (around - 4.0f * middle) / 12.0f, glm::vec3(0));
      }
  result.update_border();
  return result;
}

// The method that it has, or is becoming.
DiffuseMethod method_of(const Irradiance& irradiance) {
  return irradiance.fading ? irradiance.fading->method : irradiance.method;
}

// The method that costs least for the error it leaves. On one core (Zen 4), lobes take 0.2 to 0.4
// ms to find anew and 1 to 1.3 ns a normal, and leave 0.4 %; a cube takes 0.2 ms to sum and 4 ns a
// normal, and leaves 0.1 %. So the cube serves few normals and lobes serve many, with no lobes
// where nine coefficients are enough. From map to map lobes jump by up to 0.3 %. The cube, which is
// linear in the map, is wrong by 0.03 % of such a change, so it serves light that is followed.
// A map that follows another keeps its method.
DiffuseMethod chosen(const DiffuseChoice& choice, const Irradiance* previous) {
  if (choice.method != DiffuseMethod::automatic) return choice.method;
  if (previous && (method_of(*previous) == DiffuseMethod::irradiance_cube ||
                   method_of(*previous) == DiffuseMethod::sh9_lobes))
    return method_of(*previous);
  constexpr int kFewNormals = 50000;  // where 4 ns each cost as much as finding lobes
  const bool few = choice.evaluations > 0 && choice.evaluations <= kFewNormals;
  return few || choice.follows ? DiffuseMethod::irradiance_cube : DiffuseMethod::sh9_lobes;
}

Irradiance fit(const CubeMap& radiance, const FoldedMap& map, const DiffuseChoice& choice,
               const Irradiance* previous) {
  Irradiance result;
  const DiffuseMethod method = chosen(choice, previous);
  const DiffuseSettings& settings = choice.settings;
  result.method = method;
  result.settings = settings;
  if (method == DiffuseMethod::irradiance_cube) {
    result.cube = std::make_shared<const CubeLevel>(for_interpolation(irradiance_cube(
        settings.source == kSumSize ? map : fold(radiance, settings.source), settings.size)));
    return result;
  }
  if (method == DiffuseMethod::sh9_lobes) {
    result.polynomial = irradiance_polynomial(project_sh9(map));
    LobesOptions options;
    options.count = settings.lobes;
    if (previous && method_of(*previous) == method) options.previous = &previous->lobes;
    result.lobes = fit_lobes(map, result.polynomial, options);
    const std::array<glm::vec3, 9> part = lobe_polynomial(result.lobes);
    for (std::size_t i = 0; i < 9; ++i) result.polynomial[i] -= part[i];
    result.settings.lobes = result.lobes.count();
    return result;
  }
  if (method == DiffuseMethod::sh9) {
    result.polynomial = irradiance_polynomial(project_sh9(map));
    return result;
  }
  // The 1×1 level holds solid-angle means; the box MIP of nearest-face is the plain mean of all
  // texels.
  const CubeLevel& top = radiance.level(radiance.level_count() - 1);
  const CubeLevel& base = radiance.level(0);
  for (int f = 0; f < 6; ++f) {
    if (method != DiffuseMethod::nearest_face) {
      result.faces[std::size_t(f)] = top.texel(f, 0, 0);
      continue;
    }
    glm::dvec3 sum(0);
    for (int y = 0; y < base.size(); ++y)
      for (int x = 0; x < base.size(); ++x) sum += glm::dvec3(base.texel(f, x, y));
    result.faces[std::size_t(f)] = glm::vec3(sum / (double(base.size()) * base.size()));
  }
  return result;
}

bool is_smooth(DiffuseMethod method) {
  return method == DiffuseMethod::sh9 || method == DiffuseMethod::sh9_lobes ||
         method == DiffuseMethod::irradiance_cube;
}

std::vector<glm::vec3> at_texels(const Irradiance& irradiance, int size) {
  std::vector<glm::vec3> values;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x)
        values.push_back(glm::normalize(texel_direction(f, x, y, size)));
  evaluate(irradiance, values, values);
  return values;
}

double mean_of_magnitudes(const std::vector<glm::vec3>& values) {
  double sum = 0;
  for (const glm::vec3& v : values)
    sum += std::abs(double(v.x)) + std::abs(double(v.y)) + std::abs(double(v.z));
  return sum / 3 / double(values.size());
}

// `target` plus what is left of its difference from `previous`, which was by another method or is
// still fading.
Irradiance faded(const CubeMap& radiance, const FoldedMap& map, Irradiance target,
                 const Irradiance& previous) {
  const FadingIrradiance* last = previous.fading.get();
  FadingIrradiance fading =
      last ? *last : FadingIrradiance{previous.method, previous.settings, {}, 0};
  const bool changes =
      fading.method != target.method ||
      (target.method == DiffuseMethod::irradiance_cube && fading.settings != target.settings);
  if (!last && !changes) return target;
  std::vector<glm::vec3> light = at_texels(target, kFadeSize);
  if (changes) {
    const std::vector<glm::vec3> before =
        at_texels(fit(radiance, map, {fading.method, fading.settings}, nullptr), kFadeSize);
    fading.rest.resize(light.size(), glm::vec3(0));
    for (std::size_t i = 0; i < light.size(); ++i)
      fading.rest[i] = before[i] + fading.weight * fading.rest[i] - light[i];
    fading.method = target.method, fading.settings = target.settings, fading.weight = 1;
  }
  // The light divided by the rest.
  const double ratio = mean_of_magnitudes(light) / std::max(mean_of_magnitudes(fading.rest), 1e-30);
  fading.weight = float(std::min(double(fading.weight), kMostRest * ratio) - kMostFade * ratio);
  if (!(fading.weight > 0)) return target;
  CubeLevel cube(kFadeSize);
  std::size_t i = 0;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < kFadeSize; ++y)
      for (int x = 0; x < kFadeSize; ++x, ++i)
        cube.texel(f, x, y) = glm::max(light[i] + fading.weight * fading.rest[i], glm::vec3(0));
  cube.update_border();
  Irradiance result;
  result.method = DiffuseMethod::irradiance_cube;
  result.settings.size = kFadeSize, result.settings.source = kSumSize;
  result.cube = std::make_shared<const CubeLevel>(for_interpolation(cube));
  result.lobes = target.lobes;  // from which those of the next map start
  result.fading = std::make_shared<const FadingIrradiance>(std::move(fading));
  return result;
}

}  // namespace

Irradiance fit_irradiance(const CubeMap& radiance, const FoldedMap& map,
                          const DiffuseChoice& choice, const Irradiance* previous) {
  Irradiance target = fit(radiance, map, choice, previous);
  const bool may_fade =
      choice.follows && previous && is_smooth(previous->method) && is_smooth(target.method);
  return may_fade ? faded(radiance, map, std::move(target), *previous) : target;
}

double measure_error(const Irradiance& irradiance, const FoldedMap& map) {
  const CubeLevel exact = irradiance_cube(map, kErrorSize);
  double error = 0, truth = 0;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < kErrorSize; ++y)
      for (int x = 0; x < kErrorSize; ++x) {
        const glm::vec3 n = glm::normalize(texel_direction(f, x, y, kErrorSize));
        const glm::dvec3 e(exact.texel(f, x, y));
        const glm::dvec3 d = glm::dvec3(evaluate(irradiance, n)) - e;
        const double omega = texel_solid_angle(x, y, kErrorSize);
        error += omega * std::sqrt(glm::dot(d, d) / 3);
        truth += omega * (e.x + e.y + e.z) / 3;
      }
  return truth > 0 ? error / truth : 0;
}

}  // namespace fastibl
