#include "fastibl/scene/shadow_look.h"

#include "fastibl/core/check.h"

namespace fastibl {

void ShadowLook::validate() const {
  check(strength >= 0 && strength <= 1, "the shadow's strength must be from 0 to 1, got ",
        strength);
  for (int c = 0; c < 3; ++c)
    check(color[c] >= 0 && color[c] <= 1, "the shadow's colour must be from 0 to 1, got ",
          color[c]);
}

}  // namespace fastibl
