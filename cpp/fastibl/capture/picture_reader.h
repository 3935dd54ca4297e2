// Reads a picture where it shows texels of a map.
#pragma once

#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/exposure_doubt.h"
#include "fastibl/capture/frame_levels.h"
#include "fastibl/capture/near_lights.h"
#include "fastibl/capture/surroundings.h"
#include "fastibl/capture/texel_state.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/core/vector.h"

namespace fastibl {

class PictureReader {
 public:
  // bright: radiance of what is a light. levels: of the picture, to be made before it is read.
  PictureReader(const PosedPicture& posed, const Taken& taken, double bright,
                const Surroundings& surroundings, const FrameLevels& levels);

  // Reads it under `count` texels that show things at this depth. fine: see sample_footprints().
  // True if it shows the rim of a light there.
  bool read(const Depth& depth, int count, bool fine, Sightings& sightings, Samples& samples) const;
  // Whether this exposure tells lights from what is white.
  bool shows_lights() const { return light_ < 1; }
  // Radiance of a linear value, without vignetting.
  float scale() const { return float(scale_); }

 private:
  void leave_out_masked(int count, Sightings& sightings) const;
  void leave_out_hidden(int count, Sightings& sightings) const;
  void remove_tint(int count, Samples& samples) const;
  void scale_to_radiance(int count, const Sightings& sightings, Samples& samples) const;

  const PosedPicture& posed_;
  const Surroundings& surroundings_;
  const FrameLevels& levels_;
  std::vector<Disc> hidden_;  // parts of the picture that show lights
  double scale_;              // radiance of a linear value after untint, without vignetting
  float light_;               // linear value
  glm::vec3 untint_;          // factors on linear values
};

}  // namespace fastibl
