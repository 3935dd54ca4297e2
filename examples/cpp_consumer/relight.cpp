// Offline relighting: one photograph with a known pose, under a sun that goes round and rises.
// relight [FOLDER] writes relit-0.ppm … there. In place of sky() any map will do: of another hour,
// or of another place.
#include <fastibl/render/make_scene.h>
#include <fastibl/render/session.h>

#include <numbers>
#include <string>

#include "ppm.h"
#include "stage.h"

using namespace fastibl;

int main(int argc, char** argv) {
  const std::string folder = argc > 1 ? std::string(argv[1]) + "/" : "";
  Rig rig;
  rig.back = camera();
  const Image<std::uint8_t> photograph(rig.back.width, rig.back.height, 3, 150);

  const auto light = [](int quarter) {
    const float angle = float(quarter) * std::numbers::pi_v<float> / 2;
    return std::make_shared<const Environment>(
        environment_from(sky({std::cos(angle), std::sin(angle), 0.3f + 0.2f * float(quarter)})));
  };
  SceneOptions baked;
  baked.bake_shadow = true;  // once; then the shadow of every light takes about a millisecond
  Session session(make_scene(pyramid(), {}, {}, baked), rig, std::nullopt, light(0), nullptr,
                  make_cpu_renderer());

  Frame frame;
  frame.back = {photograph.data.data(), PixelType::uint8, photograph.width, photograph.height,
                std::ptrdiff_t{3} * photograph.width};
  frame.back_from_marker = back_from_marker();
  for (int quarter = 0; quarter < 4; ++quarter) {
    session.set_environment(light(quarter));
    frame.time = quarter;
    const FrameResult result = session.process(frame);
    write_ppm(folder + "relit-" + std::to_string(quarter) + ".ppm", result.image);
    const glm::vec3 e = result.lighting->plane_irradiance;
    std::printf("light %d: irradiance of the plane %.3f %.3f %.3f, its estimated error %.1f %%\n",
                quarter, e.r, e.g, e.b, 100 * result.predicted_error);
  }
}
