// Maps convolved with a lobe, one for each roughness, for renderers that look them up: the exact
// lobe summed over the map's solid-angle levels, finely where it matters.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "fastibl/lighting/lobe.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct PrefilterLevel {
  double parameter;    // of the lobe: alpha, or the exponent; alpha 0 and exponent ∞ copy the map
  int size;            // face edge in texels
  bool wanted = true;  // false: an empty map, which costs nothing
};
struct PrefilterOptions {
  LobeModel model = LobeModel::ggx;
  // Mean error of a level, relative to its mean, that real maps stay below. What is left out of the
  // lobe is counted in energy, brightest texels of the map included.
  double error = 0.002;
};
// Returns one map per level. Throws for a parameter outside the model's range, size < 1 or an error
// that is not in (0, 1).
std::vector<CubeMap> prefilter(std::shared_ptr<const CubeMap> map,
                               std::span<const PrefilterLevel> levels,
                               const PrefilterOptions& options = {});

// The irradiance on surfaces that face the texels of a map of `size`: π for a constant map of
// radiance 1. The cosine is summed over the level of at most `source` texels along a face: nMAE
// over seven real maps, median and worst, 0.09 and 0.39 % from 16, 0.014 and 0.07 % from 32. Throws
// std::invalid_argument for sizes outside of 1 to 256.
CubeMap irradiance_cube(const CubeMap& map, int size = 16, int source = 32);
// Radiance coefficients of the first nine harmonics; see project_sh9() of harmonic_sums.h for their
// order and constants. Times π, 2π/3 and π/4 by order they are those of the irradiance.
std::array<glm::dvec3, 9> project_sh9(const CubeMap& map);

// Parameters of `count` levels from sharp to wide, as renderers look them up.
enum class LevelMapping {
  gltf,      // ggx: level k has perceptual roughness k/(count − 1), alpha its square
  filament,  // ggx: roughness r with 2r − r² = k/(count − 1), Filament's lodToPerceptualRoughness
  unity,  // ggx: roughness r with r (1.7 − 0.7 r) = k/(count − 1), as Unity's shaders look levels
          // up
  cmft,  // phong: p = 1 + 2^(1 + 8 (1 − k/count)), cmft's gloss scale 8, bias 1 without its last
};
std::string_view name(LevelMapping mapping);
LevelMapping level_mapping(std::string_view name);  // throws std::invalid_argument, naming all
std::vector<double> level_parameters(LevelMapping mapping, int count);

}  // namespace fastibl
