// A simulated camera: turns a place's light into the picture that a sensor makes of it.
#pragma once

#include <cstdint>

#include "demo/simulator/page.h"
#include "demo/simulator/room.h"
#include "fastibl/scene/camera.h"

namespace fastibl::demo {

class Eye {
 public:
  explicit Eye(const Camera& camera);
  // seed: for the sensor's noise. The same arguments give the same bytes.
  Image<std::uint8_t> take(const Room& room, const Page& page, const Pose& camera_from_marker,
                           double exposure, std::uint32_t seed) const;

 private:
  struct FourRays {
    Float4 x, y, z;
  };
  Page::Paper paper_at(const Page& page, const glm::vec3& eye, const glm::mat3& turn,
                       std::size_t pixel) const;

  Camera camera_;
  ByteResponse response_;
  Rays rays_;                   // through the centres of pixels
  std::vector<FourRays> fine_;  // through 2 × 2 points of each pixel
  std::vector<float> factor_;   // for each pixel: gain times vignetting
  std::vector<float> noise_;    // standard normal
};

}  // namespace fastibl::demo
