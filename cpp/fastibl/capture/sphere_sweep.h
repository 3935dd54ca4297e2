// How far away the surroundings are, from how pictures taken from several places differ.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "fastibl/capture/row_poses.h"
#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/pixel_reader.h"

namespace fastibl {

// Sweeps a sphere around the centre of the map through inverse distances, and compares what two
// small pictures would show of it (a plane sweep, Collins 1996, with spheres). The costs of all
// pairs are added up, so that the distance becomes surer with every picture.
class SphereSweep {
 public:
  explicit SphereSweep(const glm::dvec3& centre) : centre_(centre) {}

  // False once there is nothing more to learn.
  bool wants_more() const { return compared_ < kEnough; }
  // Factor on light, by pixel position.
  using Vignette = std::function<double(float x, float y)>;
  // Compares a picture with an earlier one from another place, unless one like it was compared.
  // mask: as Capture has it; empty for none.
  void add(const PixelReader& pixels, const Camera& camera, const Lens& lens, const RowPoses& poses,
           const Vignette& vignette, ImageView<const std::uint8_t> mask);
  // 1 / metres: the distance that explains the pictures best, if they contradict `assumed`.
  std::optional<double> better_than(double assumed) const;

 private:
  static constexpr std::array<double, 13> kSwept{0,    0.05, 0.1, 0.15, 0.2, 0.25, 0.3,
                                                 0.35, 0.4,  0.5, 0.6,  0.8, 1};  // 1 / metres
  static constexpr std::int64_t kEnough = 20000;                                  // pixels
  using Costs = std::array<double, kSwept.size()>;

  struct View {
    RowPoses poses;
    Pose half;  // of the middle row
    Lens lens;
    glm::dvec3 eye, axis;         // marker frame; axis: where the camera looks
    int step;                     // pixels of the picture along an edge of one of these
    int height;                   // of the picture
    Image<float> brightness;      // ln of linear light; NaN where it is clipped or dark
    std::vector<glm::vec3> rays;  // of each pixel, marker frame; 0 where the lens has none
    // Brightness where the point shows; NaN where it does not.
    float at(const glm::dvec3& point) const;
  };
  static View small_view(const PixelReader& pixels, const Camera& camera, const Lens& lens,
                         const RowPoses& poses, const Vignette& vignette,
                         ImageView<const std::uint8_t> mask);
  void compare(const View& view, const View& earlier);

  glm::dvec3 centre_;
  std::vector<View> views_;  // the latest last
  Costs costs_{};            // summed over pixels
  std::int64_t compared_ = 0;
};

}  // namespace fastibl
