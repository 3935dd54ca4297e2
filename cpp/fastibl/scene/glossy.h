// Glossy light: a lobe of half-vector exponent s, (n·h)^s max(n·l, 0), by each method.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "fastibl/scene/light_arrays.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

// What shading with one exponent needs from the tables, by the angle between normal and view:
// columns over √(1 − cos θ_v) from 0 to 1.
struct GlossyLobe {
  static constexpr int kColumns = 17, kMaxTaps = 4;
  struct Column {
    // Each look-up: cosine and sine of its angle from the mirror direction, away from the normal;
    // its level; its weight (the weights sum to 1).
    std::array<glm::vec4, kMaxTaps> taps{};
    glm::vec4 spreads{1};       // squares of the look-ups' standard deviations, radians
    glm::vec2 direction{1, 0};  // of the spherical harmonics: likewise a cosine and a sine
    glm::vec4 bands{0};         // factors of bands 1 … 4
    float log_integral = 0;     // log2 of the lobe's integral
  };
  float exponent = 0;
  int taps = 1;
  float harmonics = 0;  // share that the spherical harmonics give; the look-ups give the rest
  std::array<Column, kColumns> columns;

  GlossyLobe() = default;
  GlossyLobe(const GlossyChain& chain, int taps, float exponent);
};

// The glossy term of one exponent, prepared for many normals and views. Keeps a pointer to the
// lighting, which must have its map when this is called. Throws std::invalid_argument for an
// exponent below 0 or NaN.
class GlossyShading {
 public:
  GlossyShading(const Lighting& lighting, float exponent);
  GlossyShading(Lighting&& lighting, float exponent) = delete;
  // With the light at the map's centre, or with the light at a position (marker frame), from which
  // lights and walls are seen where they are.
  glm::vec3 operator()(glm::vec3 normal, glm::vec3 view) const {
    return shaded(normal, view, nullptr);
  }
  glm::vec3 operator()(glm::vec3 normal, glm::vec3 view, glm::vec3 position) const {
    return shaded(normal, view, placed_ ? &position : nullptr);
  }
  // The same for many surface points. Without positions: with the light at the map's centre.
  void operator()(std::span<const glm::vec3> normals, std::span<const glm::vec3> views,
                  std::span<const glm::vec3> positions, std::span<glm::vec3> out) const;

 private:
  glm::vec3 shaded(glm::vec3 normal, glm::vec3 view, const glm::vec3* position) const;
  glm::vec3 reflected(glm::vec3 normal, glm::vec3 view, float cosine,
                      const glm::vec3* position) const;
  glm::vec3 from_chain(glm::vec3 normal, glm::vec3 view, float cosine,
                       const glm::vec3* position) const;

  // Whether many points are shaded at once.
  bool in_blocks() const {
    return !walls_ &&
           (method_ == GlossyMethod::mip ? exponent_ > 0
                                         : method_ != GlossyMethod::sampled && exponent_ >= 1);
  }
  glm::vec3 looked(glm::vec3 direction, const glm::vec3* position) const;
  // Factor of the average over the lobe, by the cosine of the view.
  float scale(float cosine) const;

  const Lighting* lighting_;
  GlossyMethod method_;  // of the lighting; `mip` where its chain is missing
  float exponent_;
  float level_ = 0;  // of `mip`
  GlossyLobe lobe_;
  LightArrays lights_;
  std::optional<WallsAround> walls_;  // where they are known
  bool placed_ = false;               // walls or lights are near
};

// Radiance that a lobe of half-vector exponent s ≥ 0 reflects towards the view (surface to eye);
// normal and view are unit vectors. s = 0 gives E/π, s = ∞ the mirror. Makes a GlossyShading for
// this one value: for many values, keeping one is six times as fast. Throws std::invalid_argument
// as GlossyShading does, and without a map.
glm::vec3 evaluate_glossy(const Lighting& lighting, glm::vec3 unit_normal, glm::vec3 unit_view,
                          float exponent);

}  // namespace fastibl
