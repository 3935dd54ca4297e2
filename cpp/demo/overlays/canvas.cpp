#include "demo/overlays/canvas.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace fastibl::demo {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr int kMargin = 4;       // pixels
constexpr double kColumn = 7.2;  // mean width of a character at scale 0.4, pixels

cv::Mat mat_of(Image<std::uint8_t>& picture) {
  return {picture.height, picture.width, CV_8UC3, picture.data.data()};
}
cv::Scalar scalar(Colour c) { return {double(c.r), double(c.g), double(c.b)}; }
// Clamped, because OpenCV's fixed point would overflow far outside a picture.
cv::Point point(glm::dvec2 p) {
  p = glm::clamp(p, glm::dvec2(-1e4), glm::dvec2(1e4));
  return {int(std::lround(p.x)), int(std::lround(p.y))};
}

std::vector<std::string> cells_of(const std::string& text) {
  std::vector<std::string> cells(1);
  for (const char c : text)
    if (c == '\t')
      cells.emplace_back();
    else
      cells.back() += c;
  return cells;
}

}  // namespace

Canvas::Canvas(Image<std::uint8_t>& picture)
    : picture_(picture), scale_(0.36 * std::clamp(picture.height / 480.0, 0.8, 3.0)) {}

int Canvas::line_height() const { return int(std::lround(35 * scale_)); }
int Canvas::columns(double share) const { return int(share * width() / (kColumn * scale_ / 0.4)); }

int Canvas::text_width(const std::string& text) const {
  int baseline = 0;
  return cv::getTextSize(text, kFont, scale_, 1, &baseline).width;
}

std::optional<glm::ivec2> Canvas::take(Corner corner, int width, int height) {
  const bool bottom = corner == Corner::bottom_left || corner == Corner::bottom_right;
  const bool right = corner == Corner::top_right || corner == Corner::bottom_right;
  int& used = used_[std::size_t(corner)];
  const int across = used_[std::size_t(corner) ^ 2];  // the same in the corner above or below
  if (used + across + height + 2 * kMargin > this->height() || width + kMargin > this->width())
    return std::nullopt;
  used += height + kMargin;
  return glm::ivec2(right ? this->width() - width - kMargin : kMargin,
                    bottom ? this->height() - used : used - height);
}

void Canvas::darken(glm::ivec2 at, int width, int height) {
  for (int y = std::max(0, at.y); y < std::min(picture_.height, at.y + height); ++y) {
    const int left = std::clamp(at.x, 0, picture_.width);
    const int right = std::clamp(at.x + width, 0, picture_.width);
    std::uint8_t* p = picture_.pixel(left, y);
    for (int k = 0; k < 3 * (right - left); ++k) p[k] = std::uint8_t(p[k] * 2 / 5);
  }
}

std::vector<int> Canvas::column_starts(const std::vector<Line>& lines) const {
  std::vector<int> widths;
  int alone = 0;  // width of the widest line without columns
  for (const Line& line : lines) {
    const std::vector<std::string> cells = cells_of(line.text);
    if (cells.size() == 1) {
      alone = std::max(alone, text_width(line.text));
      continue;
    }
    widths.resize(std::max(widths.size(), cells.size()));
    for (std::size_t k = 0; k < cells.size(); ++k)
      widths[k] = std::max(widths[k], text_width(cells[k]));
  }
  std::vector<int> starts{kMargin};
  for (const int width : widths) starts.push_back(starts.back() + width + 2 * kMargin);
  if (widths.empty()) starts.push_back(0);
  starts.back() = std::max(starts.back(), alone + 2 * kMargin);
  return starts;
}

void Canvas::write(glm::ivec2 at, const std::vector<Line>& lines) {
  const int step = line_height();
  const std::vector<int> starts = column_starts(lines);
  darken(at, starts.back(), step * int(lines.size()) + kMargin);
  for (std::size_t y = 0; y < lines.size(); ++y) {
    const std::vector<std::string> cells = cells_of(lines[y].text);
    for (std::size_t x = 0; x < cells.size(); ++x)
      text(at + glm::ivec2(starts[x], int(y) * step + 1), cells[x], lines[y].colour);
  }
}

void Canvas::panel(Corner corner, const std::vector<Line>& lines) {
  std::vector<Line> fitting = lines;
  while (!fitting.empty()) {
    const int width = std::min(column_starts(fitting).back(), this->width() - 2 * kMargin);
    const int height = line_height() * int(fitting.size()) + kMargin;
    if (const auto at = take(corner, width, height)) return write(*at, fitting);
    fitting.pop_back();
  }
}

void Canvas::sheet(const std::vector<Line>& lines) {
  const int width = column_starts(lines).back();
  const int height = line_height() * int(lines.size()) + kMargin;
  const glm::ivec2 at((this->width() - width) / 2, (this->height() - height) / 2);
  write(glm::max(at, glm::ivec2(0)), lines);
}

void Canvas::text(glm::ivec2 at, const std::string& text, Colour colour) {
  const cv::Point baseline(at.x, at.y + int(std::lround(27 * scale_)));
  cv::putText(mat_of(picture_), text, baseline, kFont, scale_, scalar(colour), 1, cv::LINE_AA);
}
void Canvas::line(glm::dvec2 a, glm::dvec2 b, Colour colour, int thickness) {
  cv::line(mat_of(picture_), point(a), point(b), scalar(colour), thickness, cv::LINE_AA);
}
void Canvas::arrow(glm::dvec2 a, glm::dvec2 b, Colour colour, int thickness) {
  cv::arrowedLine(mat_of(picture_), point(a), point(b), scalar(colour), thickness, cv::LINE_AA, 0,
                  0.15);
}
void Canvas::circle(glm::dvec2 middle, double radius, Colour colour, int thickness) {
  cv::circle(mat_of(picture_), point(middle), int(std::lround(radius)), scalar(colour), thickness,
             cv::LINE_AA);
}

}  // namespace fastibl::demo
