// How bright a picture is compared with what the map knows of the places that it shows.
#pragma once

#include <optional>
#include <span>

#include "fastibl/core/vector.h"

namespace fastibl {

// A small part of a picture that shows a place that the map knows.
struct LevelProbe {
  glm::vec3 linear;    // mean over the part
  glm::vec3 expected;  // at exposure 1: radiance in the map × gain × vignetting
  bool clipped;        // any of it
  bool sure = true;    // whether the map knows the place well
};

struct PictureLevel {
  int count = 0;             // of probes that it rests on
  double exposure = 1;       // that fits best: mean of the channels' medians over probes
  glm::dvec3 tint{1};        // by channel: its own median exposure divided by that
  double spread = 0;         // standard deviation of ln(linear / expected) within a channel, robust
  double deviation() const;  // standard deviation of ln(exposure) from it
};

// Values below this show nothing but noise (6 codes of 8-bit sRGB).
inline constexpr float kDarkest = 0.002f;
inline constexpr int kLeastProbes = 10;  // needed to read a level

// std::nullopt if too few probes show anything. Where the fitted exposure should show them, dark
// probes count as below the median and clipped ones as above it: without them it would be drawn
// towards what can be seen.
std::optional<PictureLevel> fit_level(std::span<const LevelProbe> probes);

// The same by what the picture shows, whatever it should show: for a place that is no longer as
// expected. Without a tint.
std::optional<PictureLevel> fit_shown(std::span<const LevelProbe> probes);

// Whether nearly everything that an exposure should show, or that the picture shows, is off by a
// factor of two or more; for pictures that are too dark or too bright for fit_level.
bool is_far_off(std::span<const LevelProbe> probes, double exposure);

}  // namespace fastibl
