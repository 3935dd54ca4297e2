// Pictures, small cameras and maps of any content, as several targets use them.
#pragma once

#include <vector>

#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/picture.h"
#include "input.h"

namespace fastibl {

// A picture that owns its pixels: a plain ground with a few values of any kind.
class OwnPicture {
 public:
  OwnPicture(Input& in, int width, int height) {
    if (width <= 0 || height <= 0) return;  // none
    picture_.type = PixelType(in.below(3));
    picture_.width = width, picture_.height = height;
    const std::size_t count = std::size_t(3 * width * height);
    const int ground = in.byte(), marks = in.below(24);
    if (picture_.type == PixelType::float32) {
      floats_.assign(count, float(ground) / 128);
      for (int i = 0; i < marks; ++i) floats_[std::size_t(in.below(int(count)))] = in.any();
      picture_.data = floats_.data(), picture_.row_bytes = 12 * width;
    } else if (picture_.type == PixelType::uint16) {
      words_.assign(count, std::uint16_t(257 * ground));
      for (int i = 0; i < marks; ++i)
        words_[std::size_t(in.below(int(count)))] = std::uint16_t(257 * in.byte());
      picture_.data = words_.data(), picture_.row_bytes = 6 * width;
    } else {
      bytes_.assign(count, std::uint8_t(ground));
      for (int i = 0; i < marks; ++i) fill_box(in, width, height);
      picture_.data = bytes_.data(), picture_.row_bytes = 3 * width;
    }
  }
  OwnPicture(const OwnPicture&) = delete;
  OwnPicture& operator=(const OwnPicture&) = delete;
  const Picture& view() const { return picture_; }

 private:
  void fill_box(Input& in, int width, int height) {
    const int x0 = in.below(width), y0 = in.below(height), code = in.byte();
    const int x1 = std::min(width, x0 + 1 + in.below(12)),
              y1 = std::min(height, y0 + 1 + in.below(12));
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x)
        for (int c = 0; c < 3; ++c)
          bytes_[std::size_t(3 * (y * width + x) + c)] = std::uint8_t(code);
  }
  Picture picture_;
  std::vector<std::uint8_t> bytes_;
  std::vector<std::uint16_t> words_;
  std::vector<float> floats_;
};

// A valid camera, up to `most` pixels wide.
inline Camera small_camera(Input& in, int most, bool wide) {
  Camera camera;
  camera.model = wide && in.chance(4) ? CameraModel(in.between(1, 2)) : CameraModel::perspective;
  camera.width = in.between(1, most), camera.height = in.between(1, most);
  camera.fx = camera.fy = in.chance(16) ? in.any_double() : camera.width * in.within(0.2f, 3);
  if (camera.model == CameraModel::equirectangular)
    camera.fx = camera.fy = camera.width / 6.283185307179586;
  camera.cx = in.chance(16) ? in.any_double() : 0.5 * camera.width;
  camera.cy = 0.5 * camera.height;
  if (camera.model != CameraModel::equirectangular && in.chance(3))
    for (int i = 0; i < 4; ++i)
      camera.distortion.push_back(in.chance(8) ? in.any() : 0.2 * in.near());
  if (in.chance(4)) camera.vignetting.push_back(in.chance(4) ? in.any() : -0.3 * in.share());
  if (in.chance(4)) camera.response = Response::gamma(in.chance(4) ? in.any() : in.within(0.5f, 4));
  if (in.chance(4)) camera.gain = in.any();
  if (in.chance(4)) camera.readout = in.share();
  camera.validate();
  return camera;
}

// Faces of 1 to `most` texels: a ground with a few values of any kind.
inline CubeMap any_map(Input& in, int most) {
  const int n = in.between(1, most);
  std::vector<glm::vec3> faces(std::size_t(6 * n * n),
                               glm::vec3(in.chance(3) ? in.any() : in.share()));
  for (int i = in.below(8); i > 0; --i) faces[std::size_t(in.below(int(faces.size())))] = in.any3();
  return CubeMap(n, faces);
}

inline bool is_clean(const CubeMap& map) {
  for (int k = 0; k < map.level_count(); ++k) {
    const CubeLevel& level = map.level(k);
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < level.size(); ++y)
        for (int x = 0; x < level.size(); ++x)
          if (!is_light(level.texel(f, x, y))) return false;
  }
  return true;
}

}  // namespace fastibl
