// The C++ detector (any OpenCV from 4.6) on the pictures on which the Python one was run; see
// tests/data/README.md.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <stdexcept>
#include <thread>

#include "fastibl/tracking/opencv/opencv_detector.h"
#include "fastibl/tracking/tracker.h"

using namespace fastibl;

namespace {

struct Vector {
  Image<std::uint8_t> grey;
  Camera camera;
  Pose truth;
  std::map<int, std::array<glm::dvec2, 4>> detected, expected;
};

Vector read(const std::string& name) {
  Vector v;
  std::ifstream pgm(std::string(TEST_DATA) + "/" + name + ".pgm", std::ios::binary);
  std::string magic;
  int width = 0, height = 0, white = 0;
  pgm >> magic >> width >> height >> white;
  pgm.get();
  v.grey = Image<std::uint8_t>(width, height, 1);
  pgm.read(reinterpret_cast<char*>(v.grey.data.data()), std::streamsize(v.grey.data.size()));
  REQUIRE(pgm.good());
  std::ifstream text(std::string(TEST_DATA) + "/" + name + ".txt");
  std::string word;
  while (text >> word) {
    if (word == "camera") {
      v.camera.width = width, v.camera.height = height;
      text >> v.camera.fx >> v.camera.fy >> v.camera.cx >> v.camera.cy;
    } else if (word == "pose") {
      glm::dmat4 m(1.0);
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 4; ++c) text >> m[c][r];
      v.truth = Pose::from_matrix(m);
    } else {
      int id = 0;
      std::array<glm::dvec2, 4> corners;
      text >> id;
      for (glm::dvec2& c : corners) text >> c.x >> c.y;
      (word == "detected" ? v.detected : v.expected)[id] = corners;
    }
  }
  REQUIRE(text.eof());
  return v;
}

Board board_of(const std::string& name) {
  return name == "kalibr" ? Board::kalibr(2, 2, 0.05, 0.3) : Board::grid(3, 4, 0.03, 0.01);
}

double largest_distance(const std::array<glm::dvec2, 4>& a, const std::array<glm::dvec2, 4>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < 4; ++i) largest = std::max(largest, glm::length(a[i] - b[i]));
  return largest;
}

}  // namespace

TEST_CASE("detects what the Python detector does, in the same convention") {
  MESSAGE("OpenCV " << std::string(opencv_version()));
  for (const std::string name : {"grid", "kalibr"}) {
    CAPTURE(name);
    const Vector v = read(name);
    const Detection found = opencv_detector()(v.grey.view(), board_of(name), v.camera);
    CHECK(found.tags.size() == v.detected.size());
    double apart = 0, off = 0;
    for (const DetectedTag& tag : found.tags) {
      REQUIRE(v.detected.count(tag.id) == 1);
      apart = std::max(apart, largest_distance(tag.corners, v.detected.at(tag.id)));
      off = std::max(off, largest_distance(tag.corners, v.expected.at(tag.id)));
    }
    MESSAGE(name << ": " << found.tags.size() << " tags, largest difference " << apart
                 << " px, largest error " << off << " px");
    CHECK(apart < 0.5);  // OpenCV 4.6 and 5.0 refine corners in windows of other sizes
    CHECK(off < 1.5);
    REQUIRE(found.start);
    CHECK(rotation_angle(found.start->rotation, v.truth.rotation) < 0.05);
  }
}

TEST_CASE("tracks within 0.1 degrees with refined corners, and worse without") {
  for (const std::string name : {"grid", "kalibr"}) {
    CAPTURE(name);
    const Vector v = read(name);
    double error[2];
    for (const bool refine : {false, true}) {
      TrackingOptions options;
      options.refine = refine;
      const auto tracked =
          track(opencv_detector(), v.grey.view(), board_of(name), v.camera, options);
      REQUIRE(tracked);
      CHECK_FALSE(tracked->ambiguous);
      error[refine] =
          rotation_angle(tracked->camera_from_marker.rotation, v.truth.rotation) * 180 / M_PI;
    }
    MESSAGE(name << ": rotation error " << error[0] << " degrees, refined " << error[1]);
    CHECK(error[1] < 0.1);
    CHECK(error[1] < error[0]);
  }
}

TEST_CASE("border width is the board's: a two-module border is not read as one of one module") {
  const Vector v = read("kalibr");
  Board board = board_of("kalibr");
  CHECK(opencv_detector()(v.grey.view(), board, v.camera).tags.size() == 4);
  board.border_bits = 1;
  CHECK(opencv_detector()(v.grey.view(), board, v.camera).tags.empty());
}

TEST_CASE("a picture without a board gives nothing") {
  const Vector v = read("grid");
  const Image<std::uint8_t> blank(v.camera.width, v.camera.height, 1, 128);
  CHECK_FALSE(opencv_detector()(blank.view(), board_of("grid"), v.camera).start);
  CHECK_FALSE(track(opencv_detector(), blank.view(), board_of("grid"), v.camera));
}

TEST_CASE("bad pictures and options are refused by name") {
  const Vector v = read("grid");
  const Image<std::uint8_t> small(16, 16, 1), colour(v.camera.width, v.camera.height, 3);
  CHECK_THROWS_WITH_AS(track(opencv_detector(), small.view(), board_of("grid"), v.camera),
                       doctest::Contains("16"), std::invalid_argument);
  CHECK_THROWS_AS(track(opencv_detector(), colour.view(), board_of("grid"), v.camera),
                  std::invalid_argument);
  CHECK_THROWS_AS(opencv_detector()(colour.view(), board_of("grid"), v.camera),
                  std::invalid_argument);
  CHECK_THROWS_AS(refine_corners(small.view(), {}, 1, v.camera), std::invalid_argument);
  CHECK_THROWS_AS(opencv_detector({true, 0.0}), std::invalid_argument);
}

TEST_CASE("one detector serves several threads, with the same result") {
  const Vector v = read("grid");
  const Detector detector = opencv_detector();
  const Board board = board_of("grid");
  const auto alone = track(detector, v.grey.view(), board, v.camera);
  std::array<std::optional<Tracked>, 4> results;
  std::vector<std::thread> threads;
  for (auto& result : results)
    threads.emplace_back([&] { result = track(detector, v.grey.view(), board, v.camera); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& result : results) CHECK(result == alone);
}
