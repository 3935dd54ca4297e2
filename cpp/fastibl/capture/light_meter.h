// The board's white paper as a light meter for the light that falls on the plane.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/capture/picture_mask.h"
#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/pixel_reader.h"

namespace fastibl {

// Relative standard deviation of a reading, from albedo, gloss and what stands around.
inline constexpr double kMeterDeviation = 0.08;

class LightMeter {
 public:
  // albedo: of the paper.
  LightMeter(const Board& board, double albedo);

  // Irradiance of the plane, RGB: the median of white places, so that less than half of them may be
  // shadowed or hidden. std::nullopt if too few of them are seen large enough, or they are clipped.
  std::optional<glm::dvec3> read(const PixelReader& pixels, const Camera& camera, const Lens& lens,
                                 const Pose& camera_from_marker, double exposure,
                                 const PictureMask& hidden = {}) const;

 private:
  struct Place {
    glm::dvec2 at;  // metres, marker frame
    double free;    // metres to the nearest ink
  };
  std::vector<Place> places_;
  double albedo_;
};

}  // namespace fastibl
