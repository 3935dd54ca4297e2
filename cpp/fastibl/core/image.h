// Images and views of them. Row 0 is on top; the centre of pixel (x, y) is at (x + 0.5, y + 0.5).
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

namespace fastibl {

namespace checks {  // they throw std::invalid_argument
void rows_apart(const char* which, std::ptrdiff_t packed, std::ptrdiff_t stride);
void not_negative(int width, int height, int channels);
void as_many_values(int width, int height, int channels, std::size_t values);
}  // namespace checks

// Borrowed pixels with interleaved channels; does not own them.
template <typename T>
struct ImageView {
  T* data = nullptr;
  int width = 0;
  int height = 0;
  int channels = 3;
  std::ptrdiff_t row_stride = 0;  // from row to row, in elements of T; 0: they are packed

  std::ptrdiff_t stride() const {
    return row_stride != 0 ? row_stride : std::ptrdiff_t{width} * channels;
  }
  T* row(int y) const { return data + y * stride(); }
  T* pixel(int x, int y) const { return row(y) + std::ptrdiff_t{x} * channels; }
  bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
  operator ImageView<const T>() const { return {data, width, height, channels, row_stride}; }
};

// Throws std::invalid_argument where rows lie closer together than they are long. which: the
// image's name in the message, as in "the mask".
template <typename T>
void check_rows(const ImageView<T>& image, const char* which) {
  const std::ptrdiff_t packed = std::ptrdiff_t{image.width} * image.channels;
  if (!image.empty()) checks::rows_apart(which, packed, image.stride());
}

// Owned pixels, rows packed. Throws std::invalid_argument for a negative size.
template <typename T>
struct Image {
  int width = 0;
  int height = 0;
  int channels = 3;
  std::vector<T> data;

  Image() = default;
  Image(int w, int h, int c, T value = {})
      : width(w), height(h), channels(c), data(count(w, h, c), value) {}

  // Throws std::invalid_argument if the fields disagree, as they can when they are set one by one.
  void validate() const { checks::as_many_values(width, height, channels, data.size()); }

  T* row(int y) { return data.data() + offset(0, y); }
  const T* row(int y) const { return data.data() + offset(0, y); }
  T* pixel(int x, int y) { return data.data() + offset(x, y); }
  const T* pixel(int x, int y) const { return data.data() + offset(x, y); }
  bool empty() const { return data.empty(); }

  ImageView<T> view() {
    return {data.data(), width, height, channels, std::ptrdiff_t{width} * channels};
  }
  ImageView<const T> view() const {
    return {data.data(), width, height, channels, std::ptrdiff_t{width} * channels};
  }
  bool operator==(const Image&) const = default;

 private:
  static std::size_t count(int w, int h, int c) {
    checks::not_negative(w, h, c);
    return std::size_t(w) * std::size_t(h) * std::size_t(c);
  }
  std::ptrdiff_t offset(int x, int y) const { return (std::ptrdiff_t{y} * width + x) * channels; }
};

}  // namespace fastibl
