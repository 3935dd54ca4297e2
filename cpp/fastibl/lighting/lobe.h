// Lobes around a direction, as prefiltered maps hold them: the view is taken along the normal, so
// that a lobe depends only on the angle to that direction.
#pragma once

#include <string_view>
#include <vector>

namespace fastibl {

enum class LobeModel {
  ggx,  // D(θ/2) cos θ of the GGX distribution; parameter alpha = perceptual roughness², 0 … 1
  phong,  // cos^p θ; parameter p ≥ 0
  blinn,  // cos^s(θ/2) cos θ, the paper's Eq. 3 seen along the normal; parameter s ≥ 0
};
std::string_view name(LobeModel model);
LobeModel lobe_model(std::string_view name);  // throws std::invalid_argument, naming all

struct Lobe {
  LobeModel model = LobeModel::ggx;
  double parameter = 1;

  // Height relative to the peak, by t = 1 − cos θ in [0, 1], which keeps its digits near the peak.
  double operator()(double t) const;
  // t at which a sharp lobe has fallen to one half (an approximation for wide ones).
  double half_height() const;
};

// The lobe, and how fast it changes, in steps of r = √t (half the chord, over √2) from 0 to 1.
struct LobeTable {
  explicit LobeTable(const Lobe& lobe);

  float steps;                // r times this is the position in the tables
  std::vector<float> height;  // relative to the peak
  std::vector<float> slope;   // |d height / dθ|, unimodal
  int steepest;               // position of its maximum
  double integral;            // of height over the sphere
};

}  // namespace fastibl
