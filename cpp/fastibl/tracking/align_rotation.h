// Finds the rotation under which pictures of distant light agree with a map of it.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "fastibl/tracking/map_features.h"
#include "fastibl/tracking/picture_features.h"

namespace fastibl {

inline constexpr std::size_t kMostViews = 2;  // pictures of one alignment

struct AlignmentOptions {
  bool note = true;              // whether features remember that they did not agree
  int coarsest = 2;              // level of MapFeatures to start at
  int rounds = 8;                // at most, for each level
  int most = 1200;               // features of a picture, at most, at the finest level
  double model_noise = 0.05;     // relative: how well footprints, lens and gain fit at best
  double misfit = 0.1;           // widths by which footprints of features may be off
  double coarse_misfit = 0.4;    // the same at coarser levels
  double gain_deviation = 0.05;  // relative error that each picture's exposure may have
  double independent = 0.4;      // share of the features whose errors are independent
};

// What is known before the pictures are looked at.
struct RotationPrior {
  glm::dmat3 rotation{1.0};     // rig_from_marker
  glm::dmat3 information{0.0};  // of w in rotation · exp([w]×): 1 / rad²
  // By how far the views' eyes are off, all alike, 1 / metres²: near things tell that, too.
  // std::nullopt: their places are known.
  std::optional<glm::dmat3> place_information = {};
};

struct Alignment {
  glm::dmat3 rotation{1.0};  // rig_from_marker
  glm::dmat3 information{
      0.0};             // of w in rotation · exp([w]×): 1 / rad², marker frame; prior included
  double residual = 0;  // robust standard deviation of log light, relative to expected noise
  double agreeing = 0;  // share of the features' weight that agrees within 3 of these
  int features = 0;     // features that took part
  double drift = 0;     // variance of the rotation of the features themselves, rad²
  glm::dvec3 moved{0};  // metres, marker frame: of the views' eyes, where their place was in doubt
  glm::dmat3 place_covariance{0.0};  // of that, metres²
  // The factor by which each picture is brighter than the map says.
  std::array<double, kMostViews> gains{1, 1};
};

// Gauss–Newton on SO(3), coarse to fine, from `start`, with Tukey's weights on the difference of
// logarithms. Gradients are the map's (inverse compositional: Baker and Matthews 2004), and
// features are texels, so that the map is read without interpolation. Features of `fine` are used,
// together with those texels of the map that have none of them nearby; whether they agree is noted
// in them. Nothing where fewer than 12 features are in view.
std::optional<Alignment> align_rotation(const MapFeatures& map, const PictureFeatures& fine,
                                        std::span<const MapView> views, const glm::dmat3& start,
                                        const RotationPrior& prior,
                                        const AlignmentOptions& options = {});

}  // namespace fastibl
