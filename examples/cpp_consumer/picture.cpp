// A picture without any camera: a pyramid lit by a given map, seen from a given pose.
#include <fastibl/render/make_scene.h>
#include <fastibl/render/session.h>

#include "ppm.h"
#include "stage.h"

using namespace fastibl;

int main(int argc, char** argv) {
  Rig rig;
  rig.back = camera();
  Material material;
  material.diffuse = {0.2f, 0.5f, 0.8f};
  const Environment light = environment_from(sky({1, 0, 0.5f}));
  Session session(make_scene(pyramid(), material), rig, std::nullopt,
                  std::make_shared<const Environment>(light), nullptr, make_cpu_renderer());

  Frame frame;
  frame.back_from_marker = back_from_marker();
  // RGBA with straight alpha, as there is no picture behind the pyramid.
  write_ppm(argc > 1 ? argv[1] : "picture.ppm", session.process(frame).image);
}
