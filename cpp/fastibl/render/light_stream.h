// Whether given light comes frame after frame, as captured light does.
#pragma once

namespace fastibl {

// Light moves where a few frames in a row bring a map each that differs little from the one before.
// It stays again when no new map has come for some frames.
class LightStream {
 public:
  // Whether a map given now follows one that was given for the frame before.
  bool follows() const { return since_set_ == 1; }
  // Call with each map. little: it follows the last one and differs little from it.
  void add(bool little) {
    in_a_row_ = little ? in_a_row_ + 1 : 0;
    since_set_ = since_new_ = 0;
  }
  void add_same() { since_set_ = 0; }
  bool moves() const { return in_a_row_ >= kFirst; }
  bool begins() const { return in_a_row_ == kFirst; }
  void stay() { in_a_row_ = 0; }
  // Call after each frame. True where light that moved stays from now on.
  bool next_frame() {
    ++since_set_, ++since_new_;
    if (!moves() || since_new_ < kStill) return false;
    stay();
    return true;
  }

 private:
  static constexpr int kFirst = 3;   // maps in a row
  static constexpr int kStill = 30;  // frames
  int in_a_row_ = 0;
  int since_set_ = 0, since_new_ = 0;  // frames
};

}  // namespace fastibl
