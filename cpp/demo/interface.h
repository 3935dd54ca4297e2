// The window's panel: every command as a check box, a list or a button.
#pragma once

#include <string>
#include <string_view>

struct GLFWwindow;

namespace fastibl::demo {

class Player;

class Interface {
 public:
  // Window units, of the panel at the window's left; high enough for what is open at first.
  static constexpr int kWidth = 300, kHeight = 560;

  // With the window's context current, after the window's own callbacks were set. desktop_gl: the
  // library draws with that alone.
  Interface(GLFWwindow* window, bool desktop_gl);
  ~Interface();  // with the context current
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
