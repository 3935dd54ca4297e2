#include "fastibl/capture/camera_side.h"

#include <utility>

#include "fastibl/capture/probe_level.h"

namespace fastibl {

CameraSide::CameraSide(const Camera& given, std::vector<float> vignette)
    : camera(given),
      pixel_vignette(std::move(vignette)),
      lens(given),
      bounds(picture_bounds(given, lens)),
      noise(given.response),
      bytes(given.response),
      probe_rays(fastibl::probe_rays(given, lens)) {}

}  // namespace fastibl
