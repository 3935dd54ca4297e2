// Cameras with OpenCV's lens models. Camera frame: x right, y down, z forward.
// Position (0, 0) is the picture's upper left corner; the centre of pixel (x, y) is at
// (x + 0.5, y + 0.5).
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/response.h"

namespace fastibl {

// Where a direction at an angle θ from the axis falls in the picture.
enum class CameraModel {
  perspective,  // f tan θ, and OpenCV's distortion
  fisheye,  // f (θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹): Kannala and Brandt 2006, as in OpenCV
  equirectangular,  // fx · longitude to the right, fy · latitude downwards
};
std::string_view name(CameraModel model);
CameraModel camera_model(std::string_view name);  // throws std::invalid_argument for unknown names

struct Camera {
  int width = 0, height = 0;              // pixels
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels; (cx, cy) in the convention above, not OpenCV's
  // Perspective: k1 k2 p1 p2 [k3 [k4 k5 k6]] of OpenCV; 0, 4, 5 or 8 numbers. Fisheye: k1 k2 k3 k4,
  // or none. Equirectangular: none.
  std::vector<double> distortion = {};
  Response response = {};  // encoded = response(exposure × gain × vignetting × radiance)
  double gain = 1;         // of this camera relative to the others
  // 1 + v1 r² + v2 r⁴ + …, r = distance from (cx, cy) in units of f.
  std::vector<double> vignetting = {};
  // Seconds from a picture's first row to its last, where known: row r is exposed around
  // time + r / height · readout. 0 for a global shutter.
  double readout = 0;
  // Boards are tracked in, and objects are drawn over, perspective pictures only. Cameras of other
  // models only measure light (see Capture).
  CameraModel model = CameraModel::perspective;
  // Degrees across a fisheye's image circle. Pixels outside it show nothing of the place; most
  // pictures are black there. 360: all that the model reaches.
  double field_of_view = 360;

  // Throws std::invalid_argument for sizes that are not from 1 to 16384 pixels, focal lengths that
  // are not from 0.001 to 10⁷, a principal point further out than 10⁷, a gain ≤ 0, a readout < 0, a
  // field of view that is not from 1 to 360, or is below 360 and not a fisheye's, another number of
  // coefficients, and any value that is not finite.
  void validate() const;

  // From OpenCV's parameters. OpenCV has pixel centres at whole numbers, so half a pixel is added
  // to cx and cy. Throws as validate() does.
  static Camera from_opencv(int width, int height, double fx, double fy, double cx, double cy,
                            std::vector<double> distortion = {},
                            CameraModel model = CameraModel::perspective);
  // A 360° camera that sees all directions, with z in the middle of the picture. Throws
  // std::invalid_argument for a size below 1.
  static Camera equirectangular(int width, int height);

  // The pixel of a point in the camera frame. It may lie outside the picture. std::nullopt for
  // points behind a perspective camera, or beyond the radius where the lens model stops growing
  // (they would fold back into the picture). For a distorted perspective camera, every call
  // computes the lens anew: for many points, make a Lens.
  std::optional<glm::dvec2> project(const glm::dvec3& point) const;
  // The direction that a pixel sees: with z = 1 for a perspective camera, else of unit length.
  // std::nullopt where the lens model does not reach.
  std::optional<glm::dvec3> unproject(const glm::dvec2& pixel) const;
  bool inside(const glm::dvec2& pixel) const {
    return pixel.x >= 0 && pixel.y >= 0 && pixel.x < width && pixel.y < height;
  }
  double vignette(const glm::dvec2& pixel) const;
  bool operator==(const Camera&) const = default;
};

// The lens of a perspective camera alone. What repeated projection needs is computed once.
class Lens {
 public:
  explicit Lens(const Camera& camera);  // throws std::invalid_argument for another model
  // The distorted position of an ideal one on the plane z = 1, and its derivative if requested.
  glm::dvec2 distort(const glm::dvec2& ideal, glm::dmat2* derivative = nullptr) const;
  bool valid(const glm::dvec2& ideal) const { return glm::dot(ideal, ideal) < limit2_; }
  double limit2() const {
    return limit2_;
  }  // squared radius up to which the model grows; may be infinite
  bool trivial() const { return trivial_; }
  std::optional<glm::dvec2> project(const glm::dvec3& point,
                                    glm::dmat2x3* derivative = nullptr) const;
  std::optional<glm::dvec3> unproject(const glm::dvec2& pixel) const;

 private:
  double fx_, fy_, cx_, cy_;
  double k_[8] = {};  // k1 k2 p1 p2 k3 k4 k5 k6
  double limit2_;
  bool trivial_;
};

// The back camera, and the front camera that is fixed to it.
struct Rig {
  Camera back = {};
  std::optional<Camera> front = {};
  Pose front_from_back = {};
  // Throws as validate() of its cameras and its pose does.
  void validate() const;
  bool operator==(const Rig&) const = default;
};

}  // namespace fastibl
