// What is known about each texel, and how a sample changes it.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/capture/sensor_noise.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/scene/cube_tiles.h"
#include "fastibl/scene/environment.h"

namespace fastibl {

// Of TexelState::bound: a picture with its camera's shortest exposure clipped there, too.
inline constexpr std::uint8_t kClipsInAll = 8;

// Arrays by tile: texel k of tile t at t · stride + k.
struct TexelState {
  explicit TexelState(TileGrid grid) : last_seen(grid) {
    const std::size_t count = std::size_t(grid.count()) * std::size_t(grid.stride());
    for (int c = 0; c < 3; ++c) value[c].assign(count, 0.0f), variance[c].assign(count, 0.0f);
    bound.assign(count, 0);
    relative.assign(count, 0);
  }
  std::vector<float> value[3], variance[3];
  std::vector<std::uint8_t> bound;      // bit c: channel c is only a lower bound; and kClipsInAll
  std::vector<std::uint16_t> relative;  // variance as an Environment has it
  TexelTimes last_seen;                 // seconds; −∞ if never
};

// The values that a picture shows for a group of texels.
struct Samples {
  alignas(64) float linear[3][kTexelLanes];
  alignas(64) float radiance_per_linear[kTexelLanes];
  alignas(64) int clipped[3][kTexelLanes];  // 0 or 1: more than a share of the footprint clips
  bool any_clipped = false;
  bool shortest = false;  // whether what clips here clips in every exposure
  // By how much a sample may differ from one whose footprint lies half a texel aside; valid if
  // `fine`, for groups that are read more finely.
  alignas(64) float spread[3][kTexelLanes];
  bool fine = false;
};

// Relative standard deviation of a sample from misregistration and the lens, whatever the sensor.
inline constexpr float kModelNoise = 0.03f;

// Takes samples of the texels [first, first + count), seen at `time`, into their estimates. unsure:
// for each texel the variance that is left, in variances of such a sample, of the channel where
// that is largest, among channels that are more than bounds; −1 where the texel was not seen.
// last_seen: of these texels, to be set; null if all were last seen at `common`.
void merge_samples(TexelState& state, std::size_t first, int count, const Sightings& sightings,
                   const Samples& samples, const SensorNoise& noise, double time, double* last_seen,
                   double common, float* unsure);
// Lets the values of all texels be wrong by this share: variances grow, `relative` stays.
void distrust(TexelState& state, double share);
// Makes texels brighter by a factor; `relative` stays.
void scale_texels(TexelState& state, std::size_t first, int count, float factor);
// Renews `relative`.
void relate_variances(TexelState& state, std::size_t first, int count);

// For each texel the sum over channels of the squared difference between its sample and `value`,
// divided by the sample's variance plus `rough`; 0 where the texel was not seen.
void compare_samples(const float* const value[3], const float* const rough[3], int count,
                     const Sightings& sightings, const Samples& samples, const SensorNoise& noise,
                     float* deviance);

// Sums over the seen texels of a tile, weighted by solid angle.
struct TileSums {
  int count = 0;
  double angle = 0, bound_angle = 0, bound_flux = 0;
  glm::dvec3 value{0}, flux{0};  // plain sum of the values; their sum times solid angle
  glm::dvec3 irradiance{0};      // sum of the values times solid angle and |z|
  double projected = 0;          // sum of solid angle times |z|
};

// angles, projected: solid angle of each texel of the tile, and that times |z| of its direction.
// last_seen: null if all were seen.
TileSums sum_tile(const TexelState& state, std::size_t first, int count, const double* last_seen,
                  const float* angles, const float* projected);

}  // namespace fastibl
