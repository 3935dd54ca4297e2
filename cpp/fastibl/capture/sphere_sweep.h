// How far away the surroundings are, from how pictures taken from several places differ.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "fastibl/capture/row_poses.h"
#include "fastibl/capture/swept_costs.h"
#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/map_surface.h"
#include "fastibl/scene/pixel_reader.h"

namespace fastibl {

// Sweeps a sphere around the centre of the map through inverse distances, and compares what two
// small pictures would show of it (a plane sweep, Collins 1996, with spheres). The costs of all
// pairs are added up by direction, so that the distance becomes surer with every picture, and a box
// can be fitted to them.
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
  // Where things are that explain the pictures best, if the pictures contradict that they are on
  // `assumed`: a sphere, or, once one was found, a box. At most one answer for each add().
  std::optional<MapSurface> better_than(const MapSurface& assumed);

 private:
  static constexpr std::int64_t kEnough = 40000;  // pixels
  using Parts = std::vector<SweptCosts::Part>;

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
  std::optional<double> better_distance(const Parts& parts, double assumed) const;
  std::optional<RoomBox> better_room(const Parts& parts, const MapSurface& assumed) const;
  // ln of the odds of a cost against another.
  double odds(double cost, double assumed) const;

  glm::dvec3 centre_;
  std::vector<View> views_;  // the latest last
  SweptCosts costs_;
  std::int64_t compared_ = 0;  // pixels
  int comparisons_ = 0;
  bool news_ = false;  // since better_than()
};

}  // namespace fastibl
