// What is printed on the tags of family 36h11.
#pragma once

namespace fastibl {

inline constexpr int kTagCount = 587;  // ids from 0
inline constexpr int kTagModules = 6;  // of data along one side, without the black border

// Whether a data module is black; row 0 on top, corners in the order of Tag::corners. Throws
// std::invalid_argument for an id that the family does not have.
bool tag_module_black(int id, int row, int column);

}  // namespace fastibl
