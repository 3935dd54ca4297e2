// Texts of .obj files: any bytes, and lines that are nearly right.

#include <stdexcept>
#include <string>

#include "fastibl/scene/obj_file.h"
#include "input.h"

namespace fastibl {

void fuzz(Input& in) {
  constexpr const char* kPieces[] = {"v ",        "vn ",     "f ",     "1 ",   "-1 ",   "2//1 ",
                                     "vt ",       "3/1/2",   "0.5 ",   "1e9 ", "nan",   "\n",
                                     "\\\n",      "#",       "\r\n",   "\t",   "9999 ", "f 1 2 3\n",
                                     "v 1 2 3\n", "usemtl ", "mtllib "};
  constexpr int kCount = sizeof(kPieces) / sizeof(*kPieces);
  std::string text;
  for (int left = in.below(400); left > 0; --left)
    if (in.chance(4))
      text.push_back(char(in.byte()));
    else
      text.append(kPieces[in.below(kCount)]);
  for (const bool more : {false, true}) try {
      ObjMaterials materials;
      read_obj(text, {.uvs = more, .colors = more}, more ? &materials : nullptr).validate();
    } catch (const std::invalid_argument&) {  // the error says why
    }
}

}  // namespace fastibl
