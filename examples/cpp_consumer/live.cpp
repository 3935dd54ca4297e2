// A live loop: a camera looks at the printed board (`fastibl board board.pdf`), and a pyramid
// stands on it, lit by what the camera has seen of the room so far.
//   live 0 700          camera 0, whose focal length is 700 pixels
//   live film.avi 700   the same, from a film
#include <fastibl/core/clock.h>
#include <fastibl/render/make_scene.h>
#include <fastibl/render/session.h>
#include <fastibl/tracking/opencv/opencv_detector.h>

#include <cstdlib>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "ppm.h"
#include "stage.h"

using namespace fastibl;

int main(int argc, char** argv) {
  if (argc < 3) return std::fprintf(stderr, "live CAMERA|FILM FOCAL_LENGTH [OUT.ppm]\n"), 2;
  const std::string from = argv[1];
  const bool film = from.find_first_not_of("0123456789") != std::string::npos;
  cv::VideoCapture source;
  if (!(film ? source.open(from) : source.open(std::atoi(argv[1]))))
    return std::fprintf(stderr, "%s does not open\n", argv[1]), 1;

  Rig rig;
  rig.back.width = int(source.get(cv::CAP_PROP_FRAME_WIDTH));
  rig.back.height = int(source.get(cv::CAP_PROP_FRAME_HEIGHT));
  rig.back.fx = rig.back.fy = std::atof(argv[2]);
  rig.back.cx = 0.5 * rig.back.width, rig.back.cy = 0.5 * rig.back.height;
  Session session(make_scene(pyramid(), {}), rig, Board::default_board(), nullptr,
                  opencv_detector(), make_cpu_renderer());

  const Stopwatch clock;
  cv::Mat bgr, rgb;
  FrameResult result;
  int frames = 0, seen = 0;
  for (; source.read(bgr); ++frames) {
    cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
    Frame frame;
    frame.time = film ? frames / 30.0 : clock.seconds();
    frame.back = {rgb.data, PixelType::uint8, rgb.cols, rgb.rows, std::ptrdiff_t(rgb.step)};
    // Most cameras choose their exposure and do not tell it; without this line it would count as
    // always 1.
    frame.back_exposure.reset();
    session.process(frame, result);
    seen += result.back_from_marker.has_value();
    // Here a program would show result.image, or hand it on.
  }
  if (!frames) return std::fprintf(stderr, "%s gives no pictures\n", argv[1]), 1;
  std::printf("board seen in %d of %d frames, map covers %.1f %%, %.1f ms a frame\n", seen, frames,
              100 * (result.environment ? result.environment->coverage : 0),
              1e3 * clock.seconds() / frames);
  write_ppm(argc > 3 ? argv[3] : "live.ppm", result.image);
}
