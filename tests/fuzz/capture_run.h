// A short life of a Capture: pictures of any content, pose, exposure and time, and checks of the
// result.
#pragma once

#include <stdexcept>

#include "fastibl/capture/capture.h"
#include "pictures.h"

namespace fastibl {

inline void check_environment(const Environment& map) {
  require(is_clean(map.radiance), "captured radiance");
  require(is_ratio(float(map.coverage)) && is_ratio(float(map.clipped)), "coverage");
  require(std::isfinite(map.predicted_error) && map.predicted_error >= 0, "predicted error");
  require(map.predicted_low >= 0 && map.predicted_low <= map.predicted_high &&
              std::isfinite(map.predicted_high),
          "predicted interval");
  for (const float c : map.confidence()) require(is_ratio(c), "confidence");
  for (const float age : map.age()) require(age >= 0, "age");
  if (map.plane_irradiance)
    require(is_light(glm::vec3(*map.plane_irradiance)), "irradiance of the plane");
  for (const LightPosition& light : map.light_positions)
    require(finite(light.position) && finite(light.direction) && light.radius >= 0,
            "place of a light");
}

inline CaptureOptions capture_options(Input& in) {
  CaptureOptions options;
  options.size = in.between(1, 24);
  if (in.chance(2)) options.board = Board::grid(1, 1 + in.below(3), 0.04, 0.01);
  if (in.chance(4)) options.centre = glm::dvec3(in.any3());
  if (in.chance(4)) options.distance = in.any_double();
  if (in.chance(4)) options.box = RoomBox{glm::dvec3(in.any3()), glm::dvec3(in.any3())};
  if (in.chance(4)) options.box = RoomBox{glm::dvec3(-1 - in.share()), glm::dvec3(1 + in.share())};
  if (options.box && in.chance(2)) options.box->yaw = in.any_double();
  options.locate_lights = !in.chance(4);
  options.doubt_exposures = in.chance(2);
  if (in.chance(8)) options.paper_albedo = in.any_double();
  if (in.chance(8)) options.plane_albedo = in.any_double();
  return options;
}

inline void run_capture(Input& in, Capture& capture) {
  std::vector<Camera> cameras;
  for (int i = 0; i < 2; ++i) cameras.push_back(small_camera(in, 20, true));
  double time = 0;
  for (int pictures = in.below(7); pictures > 0 && !in.empty(); --pictures) {
    const Camera& camera = cameras[std::size_t(in.below(2))];
    const OwnPicture picture(in, camera.width + (in.chance(32) ? 1 : 0), camera.height);
    const Pose pose = in.pose();
    std::optional<Pose> last;
    if (in.chance(4))
      last = in.chance(2) ? in.pose() : Pose{pose.rotation, pose.translation + 0.01};
    std::optional<double> exposure = 1.0;
    if (in.chance(3)) exposure = in.any_double();
    if (in.chance(5)) exposure.reset();
    time += in.chance(8) ? in.any_double() : 0.1 * in.share();
    std::vector<std::uint8_t> mask;
    ImageView<const std::uint8_t> mask_view;
    if (in.chance(6)) {
      mask.assign(std::size_t(camera.width * camera.height), in.byte());
      mask_view = {mask.data(), camera.width, camera.height, 1, camera.width};
    }
    const glm::dvec3 tint = in.chance(8) ? glm::dvec3(in.any3()) : glm::dvec3(1);
    try {
      const Taken taken = capture.add(picture.view(), camera, pose, exposure, time, mask_view, last,
                                      tint, !in.chance(8));
      require(std::isfinite(taken.exposure) && taken.exposure > 0, "exposure used");
    } catch (const std::invalid_argument&) {  // refused, and the map stays as it was
      time = capture.time();
      if (!std::isfinite(time) || time < -1e29) time = 0;
    }
    if (in.chance(8)) capture.turn(in.pose().rotation);
    if (in.chance(3)) check_environment(*capture.environment());
  }
  check_environment(*capture.environment());
  const ExposureRange range{in.chance(4) ? in.any_double() : 1e-5,
                            in.chance(4) ? in.any_double() : 1};
  const double next = capture.next_exposure(cameras[0], in.pose(), range);
  require(next >= range.shortest && next <= range.longest, "next exposure in its range");
}

}  // namespace fastibl
