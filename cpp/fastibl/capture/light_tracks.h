// Where lights are in the room, from the directions in which they are seen from several places.
#pragma once

#include <span>
#include <vector>

#include "fastibl/capture/bright_spots.h"
#include "fastibl/scene/light_position.h"
#include "fastibl/scene/map_surface.h"

namespace fastibl {

// Follows bright spots from picture to picture and triangulates them. A light at P is parametrised
// as seen from the centre c of the map: P = c + v / ρ with |v| about 1, so that a light at infinity
// (ρ = 0) is no special case (inverse depth: Civera, Davison and Montiel 2008).
class LightTracks {
 public:
  explicit LightTracks(const glm::dvec3& centre) : centre_(centre) {}

  // eye: where the picture was taken from, marker frame. shows(direction) tells whether the picture
  // would show, well inside its borders, what lies in a direction from `eye`: lights that are no
  // longer where they should be are forgotten.
  template <class Shows>
  void add(const glm::dvec3& eye, std::span<const BrightSpot> spots, const Shows& shows) {
    follow(eye, spots);
    for (Track& track : tracks_)
      if (!track.matched && shows(predicted(track, eye))) ++track.missed;
    forget();
  }

  // The lights whose distance is known to a fifth or better.
  std::vector<LightPosition> positions() const;
  // gap, 1 / m: by how much the lights, also those whose places are not known, are likely to be
  // nearer than where everything is thought to be, `usual`. seen: how much of that was observed; 0
  // where it is only what was likely before, 1 where it is certain.
  struct Nearness {
    double gap, seen;
  };
  Nearness nearness(const MapSurface& usual, bool told) const;
  // Lines of sight along which a light was seen, for lights that the last picture shows.
  struct Sight {
    glm::dvec3 eye, direction;
  };
  std::vector<Sight> sights(const LightPosition& light) const;

 private:
  struct Track {
    std::vector<Sight> sightings;
    double solid_angle = 0;  // as last seen
    glm::dvec3 v{0, 0, 1};
    double inverse_distance = 0;  // ρ, 1 / m
    glm::dmat3 covariance{1.0};   // of v across itself (two axes of `frame`) and ρ
    glm::dmat3 frame{1.0};        // columns: two axes across v, and v
    bool matched = false;
    int missed = 0;
    int away = 0;  // pictures since it was matched
  };
  void follow(const glm::dvec3& eye, std::span<const BrightSpot> spots);
  void forget();
  bool make_room();  // for another track; false if there is none
  void fit(Track& track) const;
  glm::dvec3 predicted(const Track& track, const glm::dvec3& eye) const;

  glm::dvec3 centre_;
  std::vector<Track> tracks_;
};

}  // namespace fastibl
