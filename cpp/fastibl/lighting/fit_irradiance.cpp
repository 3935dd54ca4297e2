#include "fastibl/lighting/fit_irradiance.h"

#include <cmath>

namespace fastibl {
namespace {

constexpr int kFitSize = 16;    // face edge of the level that SH and the error are summed over
constexpr int kPlaneSize = 32;  // the plane's irradiance divides every shadow: a finer sum

// Directions and flux (radiance times solid angle) of every texel of a level, for sums over the
// map. Texels of a small level are cut into pieces, an even number ≥ `at_least` along an edge, so
// that none straddles the horizon of an axis.
struct Texels {
  std::vector<glm::dvec3> directions, flux;
  std::vector<double> solid_angles;

  Texels(const CubeLevel& level, int at_least) {
    int split = (at_least + level.size() - 1) / level.size();
    if (level.size() * split % 2 != 0) ++split;
    const int n = level.size() * split;
    const std::vector<double> angle = texel_solid_angles(n);
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
          directions.push_back(glm::normalize(glm::dvec3(texel_direction(f, x, y, n))));
          solid_angles.push_back(angle[std::size_t(y) * n + std::size_t(x)]);
          flux.push_back(solid_angles.back() * glm::dvec3(level.texel(f, x / split, y / split)));
        }
  }

  glm::dvec3 irradiance(glm::dvec3 n) const {
    glm::dvec3 sum(0);
    for (std::size_t i = 0; i < flux.size(); ++i)
      sum += std::max(0.0, glm::dot(n, directions[i])) * flux[i];
    return sum;
  }
};

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

// The weights of the texels are divided by their sum: a constant map gives π at every normal.
CubeLevel irradiance_level(const CubeLevel& radiance, int size) {
  const Texels texels(radiance, kFitSize);
  CubeLevel result(size);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x) {
        const glm::dvec3 n = glm::normalize(glm::dvec3(texel_direction(f, x, y, size)));
        double weight = 0;
        for (std::size_t i = 0; i < texels.flux.size(); ++i)
          weight += std::max(0.0, glm::dot(n, texels.directions[i])) * texels.solid_angles[i];
        result.texel(f, x, y) = glm::vec3(texels.irradiance(n) * (std::numbers::pi / weight));
      }
  result.update_border();
  return result;
}

}  // namespace

glm::dvec3 sum_irradiance(const CubeMap& radiance, glm::dvec3 n) {
  return Texels(radiance.level_at_most(kPlaneSize), kPlaneSize).irradiance(n);
}

std::array<glm::dvec3, 9> project_sh9(const CubeLevel& level) {
  const Texels texels(level, kFitSize);
  std::array<glm::dvec3, 9> sh{};
  for (std::size_t i = 0; i < texels.flux.size(); ++i) {
    const glm::dvec3 &d = texels.directions[i], &flux = texels.flux[i];
    sh[0] += 0.28209479177387814 * flux;
    sh[1] += 0.48860251190291992 * d.y * flux;
    sh[2] += 0.48860251190291992 * d.z * flux;
    sh[3] += 0.48860251190291992 * d.x * flux;
    sh[4] += 1.0925484305920792 * d.x * d.y * flux;
    sh[5] += 1.0925484305920792 * d.y * d.z * flux;
    sh[6] += 0.31539156525252005 * (3 * d.z * d.z - 1) * flux;
    sh[7] += 1.0925484305920792 * d.x * d.z * flux;
    sh[8] += 0.54627421529603959 * (d.x * d.x - d.y * d.y) * flux;
  }
  return sh;
}

Irradiance fit_irradiance(const CubeMap& radiance, DiffuseMethod method,
                          const DiffuseSettings& settings) {
  Irradiance result;
  result.method = method == DiffuseMethod::automatic ? DiffuseMethod::sh9 : method;
  result.settings = settings;
  method = result.method;
  if (method == DiffuseMethod::irradiance_cube) {
    result.cube = std::make_shared<const CubeLevel>(
        irradiance_level(radiance.level_at_most(settings.source), settings.size));
    return result;
  }
  if (method == DiffuseMethod::sh9) {
    result.polynomial = irradiance_polynomial(project_sh9(radiance.level_at_most(kFitSize)));
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

double measure_error(const Irradiance& irradiance, const CubeMap& radiance) {
  const Texels texels(radiance.level_at_most(kFitSize), kFitSize);
  double error = 0, truth = 0;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 4; ++x) {
        const glm::dvec3 n = glm::normalize(glm::dvec3(texel_direction(f, x, y, 4)));
        const glm::dvec3 exact = texels.irradiance(n);
        const glm::dvec3 d = glm::dvec3(evaluate(irradiance, glm::vec3(n))) - exact;
        error += std::sqrt(glm::dot(d, d) / 3);
        truth += (exact.x + exact.y + exact.z) / 3;
      }
  return truth > 0 ? error / truth : 0;
}

}  // namespace fastibl
