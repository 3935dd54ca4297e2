// A picture that overlays share: draws text, lines and insets, and keeps how much of each corner is
// taken.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"

namespace fastibl::demo {

struct Colour {
  int r = 255, g = 255, b = 255;
};
inline constexpr Colour kWhite{}, kGrey{170, 170, 170}, kOrange{255, 160, 0}, kRed{255, 80, 60},
    kGreen{90, 220, 90}, kBlue{90, 150, 255}, kYellow{255, 225, 70};

enum class Corner { top_left, top_right, bottom_left, bottom_right };

// Tabs in the text begin columns, which are aligned in a panel.
struct Line {
  std::string text;
  Colour colour = kWhite;
};

class Canvas {
 public:
  explicit Canvas(Image<std::uint8_t>& picture);  // RGB; outlives this, which draws into it

  int width() const { return picture_.width; }
  int height() const { return picture_.height; }
  int line_height() const;  // of text, in pixels
  // How many characters fit into that share of the width.
  int columns(double share) const;

  // Takes the next free place of that size in a corner and returns its upper left corner; nothing
  // if the corner is too full.
  std::optional<glm::ivec2> take(Corner corner, int width, int height);
  // Draws lines of text on a darkened ground; lines that find no room are left out.
  void panel(Corner corner, const std::vector<Line>& lines);
  // The same in the middle of the picture.
  void sheet(const std::vector<Line>& lines);

  void text(glm::ivec2 at, const std::string& text, Colour colour);  // at: upper left; ASCII
  void line(glm::dvec2 a, glm::dvec2 b, Colour colour, int thickness = 1);
  void arrow(glm::dvec2 a, glm::dvec2 b, Colour colour, int thickness = 1);
  void circle(glm::dvec2 middle, double radius, Colour colour, int thickness = 1);
  void darken(glm::ivec2 at, int width, int height);
  std::uint8_t* pixel(int x, int y) { return picture_.pixel(x, y); }

 private:
  int text_width(const std::string& text) const;
  // Where each column of the lines begins, from the panel's left; the last number is the panel's
  // width.
  std::vector<int> column_starts(const std::vector<Line>& lines) const;
  void write(glm::ivec2 at, const std::vector<Line>& lines);

  Image<std::uint8_t>& picture_;
  double scale_;               // of text
  std::array<int, 4> used_{};  // height taken in each corner, in pixels
};

}  // namespace fastibl::demo
