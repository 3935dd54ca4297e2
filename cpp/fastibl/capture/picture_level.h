// How bright a picture is by what the map knows of the places that it shows.
#pragma once

#include <optional>
#include <span>

#include "fastibl/core/vector.h"

namespace fastibl {

// A small part of a picture that shows a place the map knows.
struct LevelProbe {
  glm::vec3 linear;    // mean over the part
  glm::vec3 expected;  // at exposure 1: radiance in the map × gain × vignetting
  bool clipped;        // any of it
};

struct PictureLevel {
  int count = 0;             // of probes that it rests on
  double exposure = 1;       // that fits best: median over probes and channels
  glm::dvec3 tint{1};        // by channel, its own median exposure over that
  double spread = 0;         // standard deviation of ln(linear / expected) within a channel, robust
  double deviation() const;  // standard deviation of ln(exposure) from it
};

// Values below show nothing but noise (6 codes of 8-bit sRGB).
inline constexpr float kDarkest = 0.002f;
inline constexpr int kLeastProbes = 10;  // that a level is read from

// Nothing where too few probes show anything. Dark and clipped probes count as below and above
// where the fitted exposure should show them: without them a median would be drawn to what can be
// seen.
std::optional<PictureLevel> fit_level(std::span<const LevelProbe> probes);

// Whether nearly all that an exposure should show, or the picture does, is off by a factor of two
// or more: of pictures that are too dark or too bright for fit_level.
bool is_far_off(std::span<const LevelProbe> probes, double exposure);

}  // namespace fastibl
