// A picture in four tiles of the area's size: each part of a pixel is in the tile of its first sample.
uniform ivec2 tile;    // size of the area
uniform int columns;  // of tiles: 1, 2 or 4

ivec2 tile_of(int part) { return ivec2(part % columns, part / columns); }
