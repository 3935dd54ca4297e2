// A camera's tables on the GPU: its response, and the ray of each pixel. Private to render/gl.
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
  bool steep() const { return steep_; }  // several codes may end within one step of the guesses

 private:
  Texture response_, guess_, rays_;
  Response response_of_;  // what is in the textures
  Camera rays_of_;
  bool steep_ = false;
};

}  // namespace fastibl
