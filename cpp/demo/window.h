// A window that shows a picture and tells which keys were pressed.
#pragma once

#include <cstdint>
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

  // rgb: packed rows, top row first; fitted into the window with its aspect kept.
  void show(const std::uint8_t* rgb, int width, int height);
  bool closed() const;
  void set_title(const std::string& title);
  // Handles events, for at most `seconds` where there are none.
  void wait(double seconds);
  // Keys since the last call, as small letters; ' ' for space, 'q' for Escape, 'h' for F1.
  std::vector<char> keys();

  struct Pixels {
    int width = 0, height = 0;
    std::vector<std::uint8_t> rgb;  // packed, top row first
  };
  Pixels pixels();  // as last shown

 private:
  void draw(int width, int height);

  GLFWwindow* window_ = nullptr;
  unsigned texture_ = 0, program_ = 0, vertex_array_ = 0;
  int picture_width_ = 0, picture_height_ = 0;
  std::vector<char> keys_;
};

}  // namespace fastibl::demo
