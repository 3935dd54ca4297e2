// The window's panel: every command as a check box, a list or a button.
#pragma once

#include <string>
#include <string_view>

struct GLFWwindow;

namespace fastibl::demo {

class Player;

class Interface {
 public:
  // The panel at the window's left, in window units; high enough for what is open at first.
  static constexpr int kWidth = 300, kHeight = 560;

  // Call it with the window's context current, after the window's own callbacks were set.
  // desktop_gl: whether the context is desktop OpenGL; the interface library draws with no other.
  Interface(GLFWwindow* window, bool desktop_gl);
  ~Interface();  // call it with the context current
  Interface(const Interface&) = delete;
  Interface& operator=(const Interface&) = delete;

  bool usable() const { return usable_; }
  // Lays the panel out and does what is clicked.
  void build(Player& player);
  void render();            // as built last; with the context current
  bool takes_keys() const;  // a text field has the focus

 private:
  void build_group(Player& player, std::string_view group);

  bool usable_ = false, built_ = false;
  std::string file_;  // in the text field
};

}  // namespace fastibl::demo
