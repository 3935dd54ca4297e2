#include "demo/window.h"

#include <epoxy/gl.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace fastibl::demo {
namespace {

// One triangle that covers the viewport, with row 0 of the picture at the top.
constexpr const char* kVertex = R"(
out vec2 uv;
void main() {
  uv = vec2(gl_VertexID == 1 ? 2.0 : 0.0, gl_VertexID == 2 ? 2.0 : 0.0);
  gl_Position = vec4(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, 0.0, 1.0);
})";
constexpr const char* kFragment = R"(
uniform sampler2D picture;
in vec2 uv;
out vec4 colour;
void main() { colour = vec4(texture(picture, uv).rgb, 1.0); })";

// Makes the window's context current only while it draws: a renderer may make one of its own
// current, and a thread cannot have both a GLX and an EGL context current.
class Current {
 public:
  explicit Current(GLFWwindow* window) { glfwMakeContextCurrent(window); }
  ~Current() { glfwMakeContextCurrent(nullptr); }
  Current(const Current&) = delete;
  Current& operator=(const Current&) = delete;
};

std::string glfw_error() {
  const char* text = nullptr;
  glfwGetError(&text);
  return text ? std::string(" (") + text + ")" : "";
}

GLuint compile(GLenum stage, const char* text) {
  const char* header =
      epoxy_is_desktop_gl() ? "#version 330 core\n" : "#version 300 es\nprecision highp float;\n";
  const char* parts[] = {header, text};
  const GLuint shader = glCreateShader(stage);
  glShaderSource(shader, 2, parts, nullptr);
  glCompileShader(shader);
  GLint done = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &done);
  if (!done) {
    char log[1024] = "";
    glGetShaderInfoLog(shader, sizeof log, nullptr, log);
    throw std::runtime_error(std::string("the window's shader does not compile: ") + log);
  }
  return shader;
}

GLuint link() {
  const GLuint vertex = compile(GL_VERTEX_SHADER, kVertex);
  const GLuint fragment = compile(GL_FRAGMENT_SHADER, kFragment);
  const GLuint program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  GLint done = 0;
  glGetProgramiv(program, GL_LINK_STATUS, &done);
  if (!done) throw std::runtime_error("the window's shaders do not link");
  return program;
}

// Desktop OpenGL 3.3 if there is such a driver, otherwise OpenGL ES 3.0.
GLFWwindow* open(int width, int height, const std::string& title) {
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  if (GLFWwindow* window = glfwCreateWindow(width, height, title.c_str(), nullptr, nullptr))
    return window;
  glfwDefaultWindowHints();
  glfwWindowHint(GLFW_CLIENT_API, GLFW_OPENGL_ES_API);
  glfwWindowHint(GLFW_CONTEXT_CREATION_API, GLFW_EGL_CONTEXT_API);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  return glfwCreateWindow(width, height, title.c_str(), nullptr, nullptr);
}

}  // namespace

Window::Window(int width, int height, const std::string& title) {
  if (!glfwInit()) throw NoDisplay("no display; use --headless" + glfw_error());
  window_ = open(width, height, title);
  if (!window_) {
    const std::string why = glfw_error();
    glfwTerminate();
    throw NoDisplay("no display with OpenGL 3.3 or ES 3.0; use --headless" + why);
  }
  glfwSetWindowUserPointer(window_, this);
  glfwSetKeyCallback(window_, [](GLFWwindow* window, int key, int, int action, int) {
    Window& self = *static_cast<Window*>(glfwGetWindowUserPointer(window));
    self.held_ = action == GLFW_REPEAT;  // the letter's event follows this one
    if (action != GLFW_PRESS) return;
    std::vector<std::string>& keys = self.keys_;
    if (key == GLFW_KEY_ESCAPE) keys.emplace_back("q");
    if (key == GLFW_KEY_F1) keys.emplace_back("h");
    if (key == GLFW_KEY_TAB) keys.emplace_back("tab");
  });
  // Letters are told by what they type, not by where their keys lie, since keyboards differ.
  glfwSetCharCallback(window_, [](GLFWwindow* window, unsigned letter) {
    Window& self = *static_cast<Window*>(glfwGetWindowUserPointer(window));
    // A key that is held down may step through a recording, but must not begin one recording after
    // the other.
    if (self.held_ && letter != 'n' && letter != ',' && letter != '.') return;
    if (letter >= 'A' && letter <= 'Z') letter += 'a' - 'A';
    if (letter < 128) self.keys_.push_back(letter == ' ' ? "space" : std::string(1, char(letter)));
  });
  const Current current(window_);
  glfwSwapInterval(0);
  desktop_gl_ = epoxy_is_desktop_gl();
  program_ = link();
  glGenVertexArrays(1, &vertex_array_);
  glGenTextures(1, &texture_);
  glBindTexture(GL_TEXTURE_2D, texture_);
  for (const GLenum filter : {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER})
    glTexParameteri(GL_TEXTURE_2D, filter, GL_LINEAR);
  for (const GLenum wrap : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T})
    glTexParameteri(GL_TEXTURE_2D, wrap, GL_CLAMP_TO_EDGE);
}

Window::~Window() {
  glfwDestroyWindow(window_);
  glfwTerminate();
}

void Window::draw(int left, int width, int height) {
  glViewport(0, 0, width, height);
  glClearColor(0.06f, 0.06f, 0.06f, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  if (picture_width_ == 0 || width <= left) return;
  const double scale =
      std::min(double(width - left) / picture_width_, double(height) / picture_height_);
  const int w = int(std::lround(picture_width_ * scale));
  const int h = int(std::lround(picture_height_ * scale));
  glDisable(GL_BLEND), glDisable(GL_SCISSOR_TEST);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, texture_);
  glViewport(left + (width - left - w) / 2, (height - h) / 2, w, h);
  glUseProgram(program_);
  glBindVertexArray(vertex_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

void Window::set_picture(const std::uint8_t* rgb, int width, int height) {
  const Current current(window_);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, texture_);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  if (width == picture_width_ && height == picture_height_)
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, rgb);
  else
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB8, width, height, 0, GL_RGB, GL_UNSIGNED_BYTE, rgb);
  picture_width_ = width, picture_height_ = height;
}

// units: window units; a fine screen has several pixels for each.
int Window::in_pixels(int units) const {
  int width = 0, height = 0, pixels = 0;
  glfwGetWindowSize(window_, &width, &height);
  glfwGetFramebufferSize(window_, &pixels, &height);
  return width > 0 ? int(std::lround(double(units) * pixels / width)) : units;
}

void Window::show(int left, const std::function<void()>& over) {
  const Current current(window_);
  int w = 0, h = 0;
  glfwGetFramebufferSize(window_, &w, &h);
  draw(in_pixels(left), w, h);
  over();
  glfwSwapBuffers(window_);
}

void Window::with_context(const std::function<void()>& body) {
  const Current current(window_);
  body();
}

Window::Pixels Window::pixels(int left, const std::function<void()>& over) {
  Pixels out;
  if (picture_width_ == 0) return out;
  const Current current(window_);
  glfwGetFramebufferSize(window_, &out.width, &out.height);
  draw(in_pixels(left), out.width,
       out.height);  // what the back buffer holds after a swap is not defined
  over();
  std::vector<std::uint8_t> rgba(std::size_t(out.width) * out.height * 4);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, out.width, out.height, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
  out.rgb.reserve(rgba.size() / 4 * 3);
  for (int y = out.height - 1; y >= 0; --y)  // OpenGL's row 0 is the lowest
    for (int x = 0; x < out.width; ++x) {
      const std::uint8_t* pixel = &rgba[(std::size_t(y) * out.width + std::size_t(x)) * 4];
      out.rgb.insert(out.rgb.end(), pixel, pixel + 3);
    }
  return out;
}

bool Window::closed() const { return glfwWindowShouldClose(window_); }
void Window::set_title(const std::string& title) { glfwSetWindowTitle(window_, title.c_str()); }
void Window::wait(double seconds) {
  if (seconds > 0)
    glfwWaitEventsTimeout(seconds);
  else
    glfwPollEvents();
}
void Window::set_size(int width, int height) { glfwSetWindowSize(window_, width, height); }
std::vector<std::string> Window::keys() { return std::exchange(keys_, {}); }

}  // namespace fastibl::demo
