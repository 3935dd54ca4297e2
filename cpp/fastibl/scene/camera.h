// Cameras with OpenCV's lens models. Camera frame: x right, y down, z forward.
// Pixel (0, 0) is the picture's upper left corner; the centre of pixel (x, y) is at (x + 0.5, y +
// 0.5).
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/response.h"

namespace fastibl {

// How a direction at an angle θ from the axis meets the picture.
enum class CameraModel {
  perspective,  // f tan θ, and OpenCV's distortion
  fisheye,  // f (θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹): Kannala and Brandt 2006, as in OpenCV
  equirectangular,  // fx · longitude to the right, fy · latitude downwards
};
std::string_view name(CameraModel model);
CameraModel camera_model(std::string_view name);  // throws std::invalid_argument for no name

struct Camera {
  int width = 0, height = 0;              // pixels
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels; (cx, cy) in the convention above, not OpenCV's
  // Perspective: k1 k2 p1 p2 [k3 [k4 k5 k6]] of OpenCV; 0, 4, 5 or 8 numbers. Fisheye: k1 k2 k3 k4,
  // or none. Equirectangular: none.
  std::vector<double> distortion = {};
  Response response = {};  // encoded = response(exposure × gain × vignetting × radiance)
  double gain = 1;         // of this camera against the others
  // 1 + v1 r² + v2 r⁴ + …, r = distance from (cx, cy) in units of f.
  std::vector<double> vignetting = {};
  // Seconds from a picture's first row to its last, where that is known: row r is exposed around
  // time + r / height · readout. 0 for a global shutter.
  double readout = 0;
  // Others than perspective ones only measure light (see Capture); boards are tracked in, and
  // objects drawn over, perspective pictures.
  CameraModel model = CameraModel::perspective;
  // Degrees across a fisheye's circle: what lies outside shows nothing of the place, and most
  // pictures are black there. 360: all that the model reaches.
  double field_of_view = 360;

  // Throws std::invalid_argument for sizes that are not from 1 to 16384 pixels, focal lengths not
  // from 0.001 to 10⁷, a principal point further than that, a gain ≤ 0, a readout < 0, a field of
  // view that is not from 1 to 360, or less than 360 of no fisheye, another number of coefficients,
  // and whatever is not finite.
  void validate() const;

  // From OpenCV's numbers, whose pixel centres are whole: half a pixel is added to cx and cy.
  // Throws as validate().
  static Camera from_opencv(int width, int height, double fx, double fy, double cx, double cy,
                            std::vector<double> distortion = {},
                            CameraModel model = CameraModel::perspective);

  // Pixel of a point in the camera frame. Nothing behind a perspective camera, nor beyond the
  // radius where the lens model stops growing (it would fold back into the picture). May lie
  // outside the picture. Of a distorted perspective camera this works the lens out anew each time:
  // for many points, make a Lens.
  std::optional<glm::dvec2> project(const glm::dvec3& point) const;
  // Direction that meets a pixel: z = 1 of a perspective camera, else of unit length. Nothing where
  // the lens model does not reach.
  std::optional<glm::dvec3> unproject(const glm::dvec2& pixel) const;
  bool inside(const glm::dvec2& pixel) const {
    return pixel.x >= 0 && pixel.y >= 0 && pixel.x < width && pixel.y < height;
  }
  double vignette(const glm::dvec2& pixel) const;
  bool operator==(const Camera&) const = default;
};

// The lens of a perspective camera alone, with what repeated projection needs worked out once.
class Lens {
 public:
  explicit Lens(const Camera& camera);  // throws std::invalid_argument for another model
  // Distorted from ideal position on the plane z = 1, and its derivative where asked for.
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

// Back camera, and the front camera fixed to it.
struct Rig {
  Camera back = {};
  std::optional<Camera> front = {};
  Pose front_from_back = {};
  // Throws as its cameras' and its pose's.
  void validate() const;
  bool operator==(const Rig&) const = default;
};

}  // namespace fastibl
