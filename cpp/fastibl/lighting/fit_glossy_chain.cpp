#include "fastibl/lighting/fit_glossy_chain.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/lighting/find_lights.h"
#include "fastibl/lighting/lobe_filter.h"

namespace fastibl {
namespace {

constexpr int kWorkingSize = 64;
constexpr float kFinestExponent = 8192;

float exponent_of(int level) { return kFinestExponent / std::exp2(2.0f * float(level - 1)); }

// Resamples a level of any size: each target texel is the mean over pieces of source texels,
// weighted by their solid angles.
CubeLevel resampled(const CubeLevel& from, int n) {
  const int m = from.size();
  CubeLevel out(n);
  const auto cut = [&](int i, int k, double& width) {  // the k-th piece of target texel i: middle
    const double begin = double(i) * m / n, end = double(i + 1) * m / n;
    const double low = std::max(begin, std::floor(begin) + k),
                 high = std::min(end, low + 1 - (low - std::floor(low)));
    width = high - low;
    return 0.5 * (low + high);
  };
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        glm::dvec3 sum(0);
        double total = 0, height, width;
        for (int j = 0;; ++j) {
          const double v = cut(y, j, height);
          if (!(height > 1e-9)) break;
          for (int i = 0;; ++i) {
            const double u = cut(x, i, width);
            if (!(width > 1e-9)) break;
            // As the piece's solid angle, by nine midpoints, or one where it is small.
            double weight = 0;
            const int reach = m >= 2 * n ? 0 : 1;
            for (int q = -reach; q <= reach; ++q)
              for (int p = -reach; p <= reach; ++p) {
                const double s = 2 * (u + p * width / 3) / m - 1,
                             t = 2 * (v + q * height / 3) / m - 1;
                weight += width * height / std::pow(1 + s * s + t * t, 1.5);
              }
            sum += weight * glm::dvec3(from.texel(f, int(u), int(v)));
            total += weight;
          }
        }
        out.texel(f, x, y) = glm::vec3(sum / total);
      }
  out.update_border();
  return out;
}

CubeLevel halved(const CubeLevel& fine) {
  const int n = fine.size() / 2;
  CubeLevel coarse(n);
  const auto reduction = CubeReduction::of(fine.size());
  for (int f = 0; f < 6; ++f) reduction->reduce(fine, {f, 0, 0, n, n}, coarse);
  return coarse;
}

void take_out(CubeLevel& level, std::span<const TakenTexel> taken, float share) {
  for (const TakenTexel& p : taken)
    level.texel(p.face, p.x, p.y) =
        glm::max(level.texel(p.face, p.x, p.y) - share * p.radiance, 0.0f);
}

// Real, orthonormal spherical harmonics up to order 4 without Condon–Shortley phase.
void harmonics_at(glm::dvec3 d, double (&y)[25]) {
  const double x = d.x, yy = d.y, z = d.z, x2 = x * x, y2 = yy * yy, z2 = z * z;
  y[0] = 0.28209479177387814;
  y[1] = 0.48860251190291992 * yy, y[2] = 0.48860251190291992 * z, y[3] = 0.48860251190291992 * x;
  y[4] = 1.0925484305920792 * x * yy, y[5] = 1.0925484305920792 * yy * z;
  y[6] = 0.31539156525252005 * (3 * z2 - 1);
  y[7] = 1.0925484305920792 * x * z, y[8] = 0.54627421529603959 * (x2 - y2);
  y[9] = 0.59004358992664352 * yy * (3 * x2 - y2), y[10] = 2.8906114426405538 * x * yy * z;
  y[11] = 0.45704579946446572 * yy * (5 * z2 - 1);
  y[12] = 0.37317633259011546 * z * (5 * z2 - 3);
  y[13] = 0.45704579946446572 * x * (5 * z2 - 1);
  y[14] = 1.4453057213202769 * z * (x2 - y2), y[15] = 0.59004358992664352 * x * (x2 - 3 * y2);
  y[16] = 2.5033429417967046 * x * yy * (x2 - y2);
  y[17] = 1.7701307697799304 * yy * z * (3 * x2 - y2);
  y[18] = 0.94617469575756008 * x * yy * (7 * z2 - 1);
  y[19] = 0.66904654355728921 * yy * z * (7 * z2 - 3);
  y[20] = 0.10578554691520431 * (35 * z2 * z2 - 30 * z2 + 3);
  y[21] = 0.66904654355728921 * x * z * (7 * z2 - 3);
  y[22] = 0.47308734787878004 * (x2 - y2) * (7 * z2 - 1);
  y[23] = 1.7701307697799304 * x * z * (x2 - 3 * y2);
  y[24] = 0.62583573544917613 * (x2 * (x2 - 3 * y2) - y2 * (3 * x2 - y2));
}

// The basis integrated over every texel of a level; the same for every map. A constant map gives
// band 0 alone, whatever error the integration leaves.
std::vector<std::array<double, 25>> harmonic_weights(int n) {
  constexpr int kPieces = 4;
  const std::vector<double> pieces = texel_solid_angles(n * kPieces),
                            angles = texel_solid_angles(n);
  std::vector<std::array<double, 25>> weights;
  std::array<double, 25> sums{};
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        auto& w = weights.emplace_back();
        for (int j = y * kPieces; j < (y + 1) * kPieces; ++j)
          for (int i = x * kPieces; i < (x + 1) * kPieces; ++i) {
            double basis[25];
            harmonics_at(glm::normalize(glm::dvec3(texel_direction(f, i, j, n * kPieces))), basis);
            const double angle = pieces[std::size_t(j) * std::size_t(n * kPieces) + std::size_t(i)];
            for (std::size_t k = 0; k < 25; ++k) w[k] += basis[k] * angle;
          }
        for (std::size_t k = 0; k < 25; ++k) sums[k] += w[k];
      }
  for (std::size_t t = 0; t < weights.size(); ++t)
    for (std::size_t k = 1; k < 25; ++k)
      weights[t][k] -= sums[k] / (4 * std::numbers::pi) * angles[t % angles.size()];
  return weights;
}

std::array<glm::vec3, 25> project_harmonics(const CubeLevel& level) {
  static const std::vector<std::array<double, 25>> weights = harmonic_weights(16);
  std::array<glm::dvec3, 25> sums{};
  const auto* w = weights.data();
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 16; ++x, ++w) {
        const glm::dvec3 radiance(level.texel(f, x, y));
        for (std::size_t i = 0; i < 25; ++i) sums[i] += (*w)[i] * radiance;
      }
  // With the constants again, what is left of the basis is plain polynomials.
  constexpr double constant[25] = {
      0.28209479177387814, 0.48860251190291992, 0.48860251190291992, 0.48860251190291992,
      1.0925484305920792,  1.0925484305920792,  0.31539156525252005, 1.0925484305920792,
      0.54627421529603959, 0.59004358992664352, 2.8906114426405538,  0.45704579946446572,
      0.37317633259011546, 0.45704579946446572, 1.4453057213202769,  0.59004358992664352,
      2.5033429417967046,  1.7701307697799304,  0.94617469575756008, 0.66904654355728921,
      0.10578554691520431, 0.66904654355728921, 0.47308734787878004, 1.7701307697799304,
      0.62583573544917613};
  std::array<glm::vec3, 25> result;
  for (std::size_t i = 0; i < 25; ++i) result[i] = glm::vec3(constant[i] * sums[i]);
  return result;
}

}  // namespace

CubeLevel working_level(const CubeMap& map) {
  check(map.size() > 0, "the map has no texels");
  for (int k = 0; k < map.level_count(); ++k)
    if (map.level(k).size() == kWorkingSize) return map.level(k);
  // No level has that size: resample the one in which find_lights() looks where lights are, so that
  // none is spread beyond that.
  int k = 0;
  while (map.level(k).size() > kFinestForLights && k + 1 < map.level_count() &&
         map.level(k + 1).size() > kWorkingSize)
    ++k;
  return resampled(map.level(k), kWorkingSize);
}

CubeLevel without_lights(const CubeLevel& source, std::span<const TakenTexel> taken) {
  CubeLevel left = source;
  take_out(left, taken, 1);
  left.update_border();
  return left;
}

std::shared_ptr<GlossyChain> fit_glossy_chain(std::shared_ptr<const CubeMap> map,
                                              const CubeLevel& source,
                                              std::span<const FoundLight> lights) {
  static const std::array<LobeFilter, 4> filters = {
      LobeFilter(64, exponent_of(1)), LobeFilter(64, exponent_of(2)),
      LobeFilter(32, exponent_of(3)), LobeFilter(16, exponent_of(4))};
  static const std::array<WideLobeFilter, 3> wide = {WideLobeFilter(8, 8, exponent_of(5)),
                                                     WideLobeFilter(8, 4, exponent_of(6)),
                                                     WideLobeFilter(8, 2, exponent_of(7))};
  auto chain = std::make_shared<GlossyChain>();
  chain->map = std::move(map);
  for (const FoundLight& light : lights) {
    chain->lights.push_back(light.light);
    chain->taken.insert(chain->taken.end(), light.parts.begin(), light.parts.end());
    chain->light_levels.push_back(chain->level_of(0.5f * light.light.angular_radius));
  }
  // `left`: what is left of the map, at the size of the previous level. `taken`: the share taken of
  // each light.
  CubeLevel base = source, left;
  std::optional<PaddedFaces> padded;
  std::vector<float> taken(lights.size(), 0.0f);
  for (int k = 1; k < GlossyChain::kLevelCount; ++k) {
    bool changed = false;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      const float share = light_taken(k, chain->light_levels[i]);
      if (share == taken[i]) continue;
      take_out(base, lights[i].parts, share - taken[i]);
      taken[i] = share;
      changed = true;
    }
    const int size = std::max(GlossyChain::kSizes[std::size_t(k)], 8);
    if (changed || k == 1) left = base;
    while (left.size() > size) left = halved(left);
    if (k <= 4 && (changed || !padded || padded->size() != left.size())) padded.emplace(left);
    chain->lobes[std::size_t(k)] =
        k <= 4 ? filters[std::size_t(k - 1)](*padded) : wide[std::size_t(k - 5)](left);
    if (k == 4) chain->harmonics = project_harmonics(left);  // 16², and all lights are out by now
  }
  return chain;
}

}  // namespace fastibl
