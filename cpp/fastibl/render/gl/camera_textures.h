// A camera's tables on the GPU: its response, and each pixel's ray. Private to render/gl.
#pragma once

#include "fastibl/render/gl/gpu.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/response.h"

namespace fastibl {

class CameraTextures {
 public:
  void upload_response(Gpu& gpu, const Response& response);
  void upload_rays(Gpu& gpu, const Camera& camera);
  void bind_response(Gpu& gpu) const;
  void bind_rays(Gpu& gpu) const;
  glm::vec2 levels() const { return levels_; }  // codes of black and white, as shares of 255
  bool steep() const { return steep_; }  // several codes may end within one step of the guesses

 private:
  Texture response_, guess_, rays_;
  Response response_of_;  // what is in the textures
  Camera rays_of_;
  glm::vec2 levels_{0, 1};
  bool steep_ = false;
};

}  // namespace fastibl
