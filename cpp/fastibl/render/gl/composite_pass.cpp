#include "fastibl/render/gl/composite_pass.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "fastibl/render/gl/copy_picture.h"
#include "fastibl/scene/pixel_reader.h"
#include "fastibl/shading/composite.h"

namespace fastibl {
namespace {

// Makes a texture at least this large: it does not shrink with the area from frame to frame.
void make_room(Gpu& gpu, Texture& t, GLenum internal, GLenum format, int width, int height,
               GLenum type = GL_UNSIGNED_BYTE) {
  gpu.allocate(t, internal, std::max(width, t.width), std::max(height, t.height), format, type);
}

// Linear light of a part of a picture, RGB.
std::vector<glm::vec3> linear_area(const Picture& picture, const Response& response,
                                   const Area& area) {
  const ByteResponse codes(response);
  const PixelReader pixels(picture, response, codes);
  std::vector<glm::vec3> out;
  out.reserve(std::size_t(area.width()) * std::size_t(area.height()));
  for (int y = area.y0; y < area.y1; ++y)
    for (int x = area.x0; x < area.x1; ++x) out.push_back(pixels.linear(x, y));
  return out;
}

// Whether the bound framebuffer encodes as sRGB what is drawn to it.
bool encodes(const ContextState& context) {
  if (context.desktop) return false;  // it is switched off there
  if (context.srgb_switch && !glIsEnabled(GL_FRAMEBUFFER_SRGB_EXT)) return false;
  GLint buffer = GL_NONE, type = GL_NONE, encoding = GL_LINEAR;
  glGetIntegerv(GL_DRAW_BUFFER0, &buffer);
  if (buffer == GL_NONE) return false;
  const auto ask = [&](GLenum what, GLint* value) {
    glGetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, GLenum(buffer), what, value);
  };
  ask(GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE, &type);
  if (type != GL_NONE) ask(GL_FRAMEBUFFER_ATTACHMENT_COLOR_ENCODING, &encoding);
  return encoding == GL_SRGB;
}

}  // namespace

void CompositePass::upload_gain(Gpu& gpu, const std::shared_ptr<const ShadowMap>& gain) {
  if (gain == gain_map_) return;
  gain_map_ = nullptr;  // until it is uploaded
  if (!gain) return;
  upload(gpu, gain->ratio, gain_);
  upload(gpu, gain->outer, outer_gain_);
  upload(gpu, gain->fine, fine_gain_);
  gain_map_ = gain;
}

void CompositePass::take(Gpu& gpu, const CameraTexture& texture, int width, int height) {
  copy_picture(gpu, texture, width, height, taken_back_);
  taken_ = true, bytes_ = {}, area_ = {};
}

void CompositePass::show(const Picture& back, const Camera& camera) {
  area_ = {};
  if (!taken_) bare_picture(back, camera, bytes_);
}

void CompositePass::run(Gpu& gpu, const ShadowPass& shadow, const ShadePass& shade,
                        const RenderInput& in) {
  const Camera& camera = *in.camera;
  upload_gain(gpu, in.plane_gain);
  const ShadowMap& place = gain_map_ ? *gain_map_ : shadow.place();
  const Area& object_area = shade.area();
  const bool matte = in.back.empty() && !taken_;
  show(in.back, camera);
  const Pose marker_from_camera = in.camera_from_marker.inverse();
  const glm::vec3 eye(marker_from_camera.translation);
  Area shadowed;
  if (place.extent > 0 && !place.no_light && eye.z > 0)
    shadowed = outline_of_plane(place.centre, place.reach(), camera, in.camera_from_marker);
  area_ = shadowed.united(object_area);
  if (area_.empty()) return;
  const int width = area_.width(), height = area_.height();
  const bool lens = !Lens(camera).trivial(), rays = lens && !shadowed.empty();
  camera_.upload_response(gpu, camera.response);
  if (rays) camera_.upload_rays(gpu, camera);
  const bool upload = !matte && !taken_;
  if (upload) {
    make_room(gpu, back_, GL_RGB8, GL_RGB, width, height);
    glPixelStorei(GL_UNPACK_ROW_LENGTH, bytes_.width);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE,
                    bytes_.pixel(area_.x0, area_.y0));
    glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  }
  // Pictures of 16 bits or floats are multiplied as they are: what lies beyond white stays so in
  // the shade.
  const bool deep = upload && in.back.type != PixelType::uint8;
  if (deep) {
    make_room(gpu, linear_back_, GL_RGB32F, GL_RGB, width, height, GL_FLOAT);
    const std::vector<glm::vec3> linear = linear_area(in.back, camera.response, area_);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, GL_RGB, GL_FLOAT, linear.data());
  }
  make_room(gpu, picture_, GL_RGBA8, GL_RGBA, width, height);
  const bool holdout = shade.has_holdout() && !object_area.empty();
  const Program& p =
      gpu.use("composite",
              {matte ? "MATTE 1" : "MATTE 0", object_area.empty() ? "OBJECT 0" : "OBJECT 1",
               shadowed.empty() ? "SHADOW 0" : "SHADOW 1", rays ? "DISTORTION 1" : "DISTORTION 0",
               "VIGNETTING " + std::to_string(camera.vignetting.size()),
               camera_.steep() ? "STEEP 1" : "STEEP 0", holdout ? "HOLDOUT 1" : "HOLDOUT 0",
               deep ? "DEEP 1" : "DEEP 0"});
  set_camera(p, camera);
  glUniform2i(p.uniform("corner"), area_.x0, area_.y0);
  glUniform1f(p.uniform("exposure"), float(in.exposure * camera.gain));
  if (!matte) glUniform2f(p.uniform("levels"), camera_.levels().x, camera_.levels().y);
  if (upload) glUniform2i(p.uniform("back_corner"), area_.x0, area_.y0);
  if (taken_) glUniform2i(p.uniform("back_corner"), 0, 0);
  glUniform4i(p.uniform("object_area"), object_area.x0, object_area.y0, object_area.x1,
              object_area.y1);
  glUniform4f(p.uniform("ratio_place"), place.centre.x, place.centre.y, place.extent,
              place.outer.empty() ? 0 : place.outer_extent);
  set(p, "fine_place", glm::vec3(place.fine_centre, place.fine.empty() ? 0 : place.fine_extent));
  set(p, "eye", eye);
  set(p, "marker_from_camera", glm::mat3(marker_from_camera.rotation));
  if (!camera.vignetting.empty()) {
    const std::vector<float> v(camera.vignetting.begin(), camera.vignetting.end());
    glUniform1fv(p.uniform("vignetting"), GLsizei(v.size()), v.data());
  }
  camera_.bind_response(gpu);
  if (!matte) gpu.bind("back", taken_ ? taken_back_ : back_);
  if (deep) gpu.bind("linear_back", linear_back_);
  if (!object_area.empty()) gpu.bind("object", shade.object());
  if (holdout) gpu.bind("holdout", shade.holdout());
  if (!shadowed.empty()) {
    gpu.bind("ratio_map", gain_map_ ? gain_ : shadow.ratio());
    gpu.bind("outer_map", !gain_map_ ? shadow.outer() : place.outer.empty() ? gain_ : outer_gain_);
    gpu.bind("fine_map", !gain_map_ ? shadow.fine() : place.fine.empty() ? gain_ : fine_gain_);
  }
  if (rays) camera_.bind_rays(gpu);
  gpu.target(0, picture_);
  gpu.draw_full_screen(width, height);
}

void CompositePass::image(Gpu& gpu, Image<std::uint8_t>& out) {
  Area area = area_;
  if (!taken_)
    out = bytes_;
  else if (area = {0, 0, taken_back_.width, taken_back_.height};
           out.width != area.x1 || out.height != area.y1 || out.channels != 3)
    out = Image<std::uint8_t>(area.x1, area.y1, 3);
  if (area.empty()) return;
  const int width = area.width(), height = area.height();
  const std::size_t size = std::size_t(width) * std::size_t(height) * 4;
  const Gpu::Scope scope(gpu);
  if (taken_) fill_screen(gpu);
  // Reads into memory that the driver shares with the GPU, and from there to where it belongs.
  if (!read_back_) read_back_ = gpu.new_buffer();
  glBindBuffer(GL_PIXEL_PACK_BUFFER, read_back_);
  if (size > read_back_size_) {
    glBufferData(GL_PIXEL_PACK_BUFFER, GLsizeiptr(size), nullptr, GL_STREAM_READ);
    read_back_size_ = size;
  }
  gpu.target(0, taken_ ? screen_ : picture_);
  glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
  const auto* drawn = static_cast<const std::uint8_t*>(
      glMapBufferRange(GL_PIXEL_PACK_BUFFER, 0, GLsizeiptr(size), GL_MAP_READ_BIT));
  if (!drawn) throw std::runtime_error("the GL driver does not give the picture back");
  for (int y = 0; y < height; ++y) {
    const std::uint8_t* from = drawn + std::size_t(y) * std::size_t(width) * 4;
    std::uint8_t* to = out.pixel(area.x0, area.y0 + y);
    if (out.channels == 4) {
      std::copy_n(from, width * 4, to);
      continue;
    }
    // Copies four bytes at once; the next pixel's write replaces the last of them.
    for (int x = 0; x + 1 < width; ++x, from += 4, to += 3) std::memcpy(to, from, 4);
    std::memcpy(to, from, 3);
  }
  glUnmapBuffer(GL_PIXEL_PACK_BUFFER);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
}

void CompositePass::fill_screen(Gpu& gpu) {
  const auto copy = [&](const Texture& from, const Area& to) {
    gpu.target(0, from), gpu.target(1, screen_);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, gpu.framebuffer(0));
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, gpu.framebuffer(1));
    glBlitFramebuffer(0, 0, to.width(), to.height(), to.x0, to.y0, to.x1, to.y1,
                      GL_COLOR_BUFFER_BIT, GL_NEAREST);
  };
  if (taken_) {
    const int width = taken_back_.width, height = taken_back_.height;
    gpu.allocate(screen_, GL_RGBA8, width, height, GL_RGBA, GL_UNSIGNED_BYTE);
    copy(taken_back_, {0, 0, width, height});
  } else {
    std::vector<std::uint8_t> rgba;
    const std::uint8_t* data = bytes_.data.data();
    if (bytes_.channels == 3) {  // the texture has four channels, like what is copied into it
      rgba.resize(bytes_.data.size() / 3 * 4, 255);
      for (std::size_t i = 0; i < rgba.size() / 4; ++i) std::copy_n(data + 3 * i, 3, &rgba[4 * i]);
      data = rgba.data();
    }
    gpu.allocate(screen_, GL_RGBA8, bytes_.width, bytes_.height, GL_RGBA, GL_UNSIGNED_BYTE, data);
  }
  if (!area_.empty()) copy(picture_, area_);
}

void CompositePass::present(Gpu& gpu, GLuint framebuffer, int width, int height) {
  if (bytes_.empty() && !taken_) return;
  fill_screen(gpu);
  // Drawn, because nothing can be copied to multisampled framebuffers, and drivers differ in
  // whether they encode what they copy to sRGB ones.
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  const Program& p = gpu.use("present", {encodes(gpu.state()) ? "ENCODES 1" : "ENCODES 0"});
  glUniform2f(p.uniform("size"), float(width), float(height));
  gpu.bind("screen", screen_);
  set_sampling(GL_TEXTURE_2D, GL_LINEAR, GL_LINEAR);
  gpu.draw_full_screen(width, height);
}

}  // namespace fastibl
