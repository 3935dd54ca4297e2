// Lens parameters, responses and poses, as calibration files may hold them.
#include "fastibl/scene/camera.h"

#include "input.h"

namespace fastibl {
namespace {

Response response(Input& in) {
  switch (in.below(4)) {
    case 1:
      return Response::gamma(in.any_double());
    case 2: {
      std::vector<float> curve;
      const bool rising = in.chance(2);
      for (int n = in.below(40), i = 0; i < n; ++i)
        curve.push_back(rising ? std::pow(float(i) / float(std::max(n - 1, 1)), 1 + in.share())
                               : in.any());
      return Response::from_curve(curve);
    }
    default:
      return {};
  }
}

Camera camera(Input& in) {
  Camera camera;
  const bool usual = in.chance(2);
  camera.model = CameraModel(in.below(3));
  camera.width = usual ? 1 + in.below(4000) : in.below(65536) - 100;
  camera.height = usual ? 1 + in.below(4000) : in.below(65536) - 100;
  camera.fx = usual ? in.within(1, 4000) : in.any_double();
  camera.fy = usual ? camera.fx : in.any_double();
  camera.cx = usual ? camera.width * 0.5 : in.any_double();
  camera.cy = usual ? camera.height * 0.5 : in.any_double();
  const int counts[] = {0, 4, 5, 8, 4, in.below(16)};
  for (int n = counts[in.below(6)]; n > 0; --n)
    camera.distortion.push_back(in.chance(4) ? in.any_double() : 0.5 * in.near());
  for (int n = in.below(4); n > 0; --n)
    camera.vignetting.push_back(in.chance(4) ? in.any_double() : 0.3 * in.near());
  camera.gain = in.chance(4) ? in.any_double() : 1;
  camera.readout = in.chance(4) ? in.any_double() : 0;
  camera.response = response(in);
  return camera;
}

void use_response(Input& in, const Response& response) {
  for (int i = 0; i < 4; ++i) {
    require(is_ratio(response.decode(in.any())), "decoded value");
    require(is_ratio(response.encode(in.any())), "encoded value");
  }
  if (!in.chance(16)) return;
  const ByteResponse bytes(response);
  for (int k = 0; k < 256; ++k) {
    require(is_ratio(bytes.decode(std::uint8_t(k))), "decoded byte");
    require(k == 0 || bytes.decode(std::uint8_t(k)) >= bytes.decode(std::uint8_t(k - 1)),
            "decoded bytes rise");
  }
  bytes.encode(in.any());
}

void use_pose(Input& in) {
  glm::dmat4 matrix = in.pose().matrix();
  matrix[in.below(4)][in.below(4)] += in.chance(2) ? 1e-7 : in.any_double();
  const Pose pose = Pose::from_matrix(matrix);
  const Pose back = pose * pose.inverse();
  require(finite(back.translation), "a pose times its inverse");
  const glm::dvec3 w = rotation_vector(pose.rotation);
  require(finite(w) && glm::length(w) < 3.15, "rotation vector");
  require(rotation_angle(rotation_from_vector(w), pose.rotation) < 1e-5,
          "rotation from its vector");
}

}  // namespace

void fuzz(Input& in) {
  const Camera c = camera(in);
  c.validate();
  const double scale =
      std::max({1.0, std::abs(c.cx), std::abs(c.cy), std::abs(c.fx), std::abs(c.fy)});
  for (int i = 0; i < 6; ++i) {
    const glm::dvec3 point(in.any3());
    if (const auto pixel = c.project(point))
      require(std::isfinite(pixel->x) && std::isfinite(pixel->y), "projected pixel");
    const glm::dvec2 pixel = in.chance(3) ? glm::dvec2(in.any_double(), in.any_double())
                                          : glm::dvec2(in.share() * c.width, in.share() * c.height);
    c.vignette(pixel);
    const auto ray = c.unproject(pixel);
    if (!ray) continue;
    require(finite(*ray) && glm::length(*ray) > 0, "unprojected direction");
    const auto again = c.project(*ray);
    if (again && c.inside(pixel))
      require(glm::length(*again - pixel) < 1e-3 * scale, "pixel there and back");
  }
  if (c.model == CameraModel::perspective) {
    const Lens lens(c);
    glm::dmat2 derivative;
    const glm::dvec2 ideal(in.any_double(), in.any_double());
    if (lens.valid(ideal)) lens.distort(ideal, &derivative);
    glm::dmat2x3 by_point;
    lens.project(glm::dvec3(in.near3()), &by_point);
  }
  use_response(in, c.response);
  use_pose(in);
}

}  // namespace fastibl
