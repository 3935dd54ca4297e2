// A picture without any camera: a pyramid lit by a given map, seen from a given pose, written as
// PPM.
#include <fastibl/render/make_scene.h>
#include <fastibl/render/session.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

using namespace fastibl;

// Grey all around, and a bright warm sky on the side of +x.
static CubeMap sky() {
  const int size = 32;
  std::vector<glm::vec3> faces(6 * size * size, glm::vec3(0.5f));
  std::fill_n(faces.begin(), size * size, glm::vec3(3.0f, 2.4f, 1.8f));
  return CubeMap(size, faces);
}

// 10 cm wide and high, standing on the marker plane.
static Mesh pyramid() {
  Mesh mesh;
  mesh.vertices = {
      {-.05f, -.05f, 0}, {.05f, -.05f, 0}, {.05f, .05f, 0}, {-.05f, .05f, 0}, {0, 0, .1f}};
  mesh.triangles = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}, {0, 2, 1}, {0, 3, 2}};
  return mesh;
}

int main(int argc, char** argv) {
  Rig rig;
  rig.back = {.width = 320, .height = 240, .fx = 300, .fy = 300, .cx = 160, .cy = 120};

  Material material;
  material.diffuse = {0.2f, 0.5f, 0.8f};
  Session session(make_scene(pyramid(), material), rig, std::nullopt,
                  std::make_shared<const Environment>(environment_from(sky())), nullptr,
                  make_cpu_renderer());

  // From 40 cm away, 45° above the table: x right, y down, z forward of the camera in rows.
  const double s = std::sqrt(0.5);
  const glm::dmat3 rows({1, 0, 0}, {0, -s, -s}, {0, s, -s});
  Frame frame;
  frame.back_from_marker = Pose{glm::transpose(rows), {0, 0.02, 0.4}};
  const FrameResult result = session.process(frame);

  // The picture is RGBA with straight alpha, as there is nothing behind: over white.
  std::FILE* file = std::fopen(argc > 1 ? argv[1] : "picture.ppm", "wb");
  if (!file) return 1;
  std::fprintf(file, "P6\n%d %d\n255\n", result.image.width, result.image.height);
  for (std::size_t i = 0; i < result.image.data.size(); i += 4)
    for (std::size_t c = 0; c < 3; ++c) {
      const int alpha = result.image.data[i + 3];
      std::fputc((result.image.data[i + c] * alpha + 255 * (255 - alpha)) / 255, file);
    }
  return std::fclose(file);
}
