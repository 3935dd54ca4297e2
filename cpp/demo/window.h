// A window with a picture, room for an interface, and a list of the keys that were pressed.
#pragma once

#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

struct GLFWwindow;

namespace fastibl::demo {

class Window {
 public:
  struct NoDisplay : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
  };

  Window(int width, int height, const std::string& title);  // throws NoDisplay
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  // rgb: packed rows, top row first.
  void set_picture(const std::uint8_t* rgb, int width, int height);
  // Shows the picture, fitted with its aspect kept into what is right of `left` window units, and
  // then what `over` draws with the context current.
  void show(int left, const std::function<void()>& over);
  // Runs other work that needs the context.
  void with_context(const std::function<void()>& body);
  bool desktop_gl() const { return desktop_gl_; }
  GLFWwindow* handle() const { return window_; }
  void set_size(int width, int height);
  bool closed() const;
  void set_title(const std::string& title);
  // Handles events; if there are none, waits for them for at most `seconds`.
  void wait(double seconds);
  // The keys since the last call: small letters and signs as they are typed, "space" and "tab"; "q"
  // for Escape, "h" for F1.
  std::vector<std::string> keys();

  struct Pixels {
    int width = 0, height = 0;
    std::vector<std::uint8_t> rgb;  // packed, top row first
  };
  Pixels pixels(int left, const std::function<void()>& over);  // as show() shows it

 private:
  void draw(int left, int width, int height);  // in pixels
  int in_pixels(int units) const;

  GLFWwindow* window_ = nullptr;
  unsigned texture_ = 0, program_ = 0, vertex_array_ = 0;
  int picture_width_ = 0, picture_height_ = 0;
  bool desktop_gl_ = true, held_ = false;  // held_: whether the last key is held
  std::vector<std::string> keys_;
};

}  // namespace fastibl::demo
