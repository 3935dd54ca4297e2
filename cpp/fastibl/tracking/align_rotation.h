// The rotation under which pictures of distant light agree with a map of it.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "fastibl/tracking/map_features.h"
#include "fastibl/tracking/picture_features.h"

namespace fastibl {

inline constexpr std::size_t kMostViews = 2;  // pictures of one alignment

struct AlignmentOptions {
  bool note = true;              // whether features keep in mind that they did not agree
  int coarsest = 2;              // level of MapFeatures to begin with
  int rounds = 8;                // at most, a level
  int most = 1200;               // features of a picture, at the finest level
  double model_noise = 0.05;     // relative: footprints, lens and gain fit no better
  double misfit = 0.1;           // widths by which footprints of features may be off
  double coarse_misfit = 0.4;    // the same where the finest level is still to come
  double gain_deviation = 0.05;  // relative, by which each picture's exposure may be wrong
  double independent = 0.4;      // share of the features that have errors of their own
};

// What is known before the pictures are looked at.
struct RotationPrior {
  glm::dmat3 rotation{1.0};     // rig_from_marker
  glm::dmat3 information{0.0};  // of w in rotation · exp([w]×): 1 / rad²
};

struct Alignment {
  glm::dmat3 rotation{1.0};  // rig_from_marker
  glm::dmat3 information{
      0.0};             // of w in rotation · exp([w]×): 1 / rad², marker frame; prior included
  double residual = 0;  // robust standard deviation of log light, of what noise lets expect
  double agreeing = 0;  // share of the weight of features that agree within 3 of these
  int features = 0;     // that took part
  double drift = 0;     // variance of the rotation of the features themselves, rad²
  // By which each picture is brighter than the map says.
  std::array<double, kMostViews> gains{1, 1};
};

// Gauss–Newton on SO(3), coarse to fine, from `start`, with Tukey's weights on the difference of
// logarithms; gradients are the map's (inverse compositional: Baker and Matthews 2004), features
// are texels, so that the map is read without interpolation. fine: come last, with those texels of
// the map that have none around them; notes in them whether they agree. Nothing where fewer than 12
// features are in view.
std::optional<Alignment> align_rotation(const MapFeatures& map, const PictureFeatures& fine,
                                        std::span<const MapView> views, const glm::dmat3& start,
                                        const RotationPrior& prior,
                                        const AlignmentOptions& options = {});

}  // namespace fastibl
