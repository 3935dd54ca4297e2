// Packing and reading of shadow maps; see core/wide.h for how it is compiled.

#if defined(FASTIBL_IN_AVX2) || defined(FASTIBL_IN_AVX512)
#define FASTIBL_WITH_256
#endif

#ifndef FASTIBL_IN_AVX512
// Codes of `count` ratios.
FASTIBL_TARGET void encode(const float* ratios, int count, float range, std::int16_t* codes) {
  const float share = 1 / range;
  int i = 0;
#ifdef FASTIBL_WITH_256
  const __m256 all = _mm256_set1_ps(share), half = _mm256_set1_ps(0.5f),
               steps = _mm256_set1_ps(float(kRatioSteps));
  const __m128i most = _mm_set1_epi16(kRatioSteps / 2), least = _mm_set1_epi16(-kRatioSteps / 2);
  for (; i + 8 <= count; i += 8) {
    const __m256i code =
        _mm256_cvtps_epi32(_mm256_mul_ps(_mm256_sub_ps(_mm256_mul_ps(_mm256_loadu_ps(ratios + i), all), half), steps));
    const __m128i packed =
        _mm_packs_epi32(_mm256_castsi256_si128(code), _mm256_extracti128_si256(code, 1));
    _mm_storeu_si128((__m128i*)(codes + i), _mm_max_epi16(least, _mm_min_epi16(packed, most)));
  }
#endif
  for (; i < count; ++i) codes[i] = ratio_code(ratios[i] * share);
}

// Columns of `size` texels of a row and the one below it, RGB; one more code is read, and ignored.
FASTIBL_TARGET void interleave(const std::int16_t* row, const std::int16_t* below, int size,
                               ShadowLookUp::Column* out) {
  for (int x = 0; x < size; ++x) {
#ifdef FASTIBL_WITH_256
    const __m128i a = _mm_loadl_epi64((const __m128i*)(row + 3 * x)),
                  b = _mm_loadl_epi64((const __m128i*)(below + 3 * x));
    _mm_store_si128((__m128i*)(out + x), _mm_unpacklo_epi16(a, b));
#else
    for (int c = 0; c < 3; ++c)
      out[x].code[c][0] = row[3 * x + c], out[x].code[c][1] = below[3 * x + c];
#endif
  }
}

#endif

// Finds the texels of `count` points, a multiple of 16, and which lie inside; returns how many.
FASTIBL_TARGET int find_texels(const ShadowPlace& place, const float* points, int count,
                               Places& out) {
  int found = 0;
#if defined(FASTIBL_IN_AVX512)
  const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
  const __m512i odd = _mm512_add_epi32(even, _mm512_set1_epi32(1)), none = _mm512_setzero_si512();
  const __m512 scale = _mm512_set1_ps(place.scale);
  const __m512i last = _mm512_set1_epi32(place.last()), border = _mm512_set1_epi32(place.kBorder);
  const __m512i part = _mm512_set1_epi32(kWeightSteps - 1), full = _mm512_set1_epi32(kWeightSteps);
  const __m512i row_and_one = _mm512_set1_epi32((place.size + 1) << 16 | 1);
  for (int i = 0; i < count; i += 16) {
    const __m512 a = _mm512_loadu_ps(points + 2 * i), b = _mm512_loadu_ps(points + 2 * i + 16);
    __m512i x = _mm512_cvtps_epi32(_mm512_add_ps(
        _mm512_mul_ps(_mm512_permutex2var_ps(a, even, b), scale), _mm512_set1_ps(place.shift_x)));
    __m512i y = _mm512_cvtps_epi32(_mm512_add_ps(
        _mm512_mul_ps(_mm512_permutex2var_ps(a, odd, b), scale), _mm512_set1_ps(place.shift_y)));
    __mmask16 in = _mm512_cmple_epu32_mask(_mm512_max_epu32(x, y), last);
    if (in != 0xffff) {
      const __m512i outside = _mm512_sub_epi32(none, border);
      in = _mm512_cmpgt_epi32_mask(_mm512_min_epi32(x, y), outside) &
           _mm512_cmplt_epi32_mask(_mm512_max_epi32(x, y), _mm512_add_epi32(last, border));
      x = _mm512_min_epi32(_mm512_max_epi32(x, none), last);
      y = _mm512_min_epi32(_mm512_max_epi32(y, none), last);
    }
    const __m512i fx = _mm512_and_si512(x, part), fy = _mm512_and_si512(y, part);
    const __m512i both = _mm512_mulhrs_epi16(fx, _mm512_add_epi32(fy, fy));
    const __m512i right = _mm512_sub_epi32(fx, both), below = _mm512_sub_epi32(fy, both);
    const __m512i first = _mm512_sub_epi32(_mm512_sub_epi32(full, fx), below);
    _mm512_store_si512(out.left + i, _mm512_or_si512(first, _mm512_slli_epi32(below, 16)));
    _mm512_store_si512(out.right + i, _mm512_or_si512(right, _mm512_slli_epi32(both, 16)));
    const __m512i row = _mm512_slli_epi32(_mm512_srli_epi32(y, kWeightBits), 16);
    _mm512_store_si512(
        out.at + i,
        _mm512_madd_epi16(_mm512_or_si512(_mm512_srli_epi32(x, kWeightBits), row), row_and_one));
    out.inside[i / 16] = in;
    found += __builtin_popcount(in);
  }
#elif defined(FASTIBL_IN_AVX2)
  const __m256 scale = _mm256_set1_ps(place.scale);
  const __m256 shift = _mm256_setr_ps(place.shift_x, place.shift_y, place.shift_x, place.shift_y,
                                      place.shift_x, place.shift_y, place.shift_x, place.shift_y);
  const __m256i none = _mm256_setzero_si256(), last = _mm256_set1_epi32(place.last());
  const __m256i outside = _mm256_set1_epi32(-place.kBorder),
                beyond = _mm256_set1_epi32(place.last() + place.kBorder);
  const __m256i part = _mm256_set1_epi32(kWeightSteps - 1), full = _mm256_set1_epi32(kWeightSteps);
  const __m256i row_and_one = _mm256_set1_epi32((place.size + 1) << 16 | 1);
  const auto pick = [](__m256 a, __m256 b, auto which) FASTIBL_TARGET {
    return _mm256_permute4x64_epi64(_mm256_castps_si256(_mm256_shuffle_ps(a, b, which.value)),
                                    0xd8);
  };
  for (int i = 0; i < count; i += 8) {
    const auto whole = [&](const float* p) FASTIBL_TARGET {
      return _mm256_castsi256_ps(
          _mm256_cvtps_epi32(_mm256_add_ps(_mm256_mul_ps(_mm256_loadu_ps(p), scale), shift)));
    };
    const __m256 a = whole(points + 2 * i), b = whole(points + 2 * i + 8);
    __m256i x = pick(a, b, std::integral_constant<int, 0x88>{}),
            y = pick(a, b, std::integral_constant<int, 0xdd>{});
    const __m256i least = _mm256_min_epi32(x, y), most = _mm256_max_epi32(x, y);
    const int in = _mm256_movemask_ps(_mm256_castsi256_ps(
        _mm256_and_si256(_mm256_cmpgt_epi32(least, outside), _mm256_cmpgt_epi32(beyond, most))));
    x = _mm256_min_epi32(_mm256_max_epi32(x, none), last);
    y = _mm256_min_epi32(_mm256_max_epi32(y, none), last);
    const __m256i fx = _mm256_and_si256(x, part), fy = _mm256_and_si256(y, part);
    const __m256i both = _mm256_mulhrs_epi16(fx, _mm256_add_epi32(fy, fy));
    const __m256i right = _mm256_sub_epi32(fx, both), below = _mm256_sub_epi32(fy, both);
    const __m256i first = _mm256_sub_epi32(_mm256_sub_epi32(full, fx), below);
    const auto store = [i](std::int32_t* to, __m256i v)
                           FASTIBL_TARGET { _mm256_store_si256((__m256i*)(to + i), v); };
    store(out.left, _mm256_or_si256(first, _mm256_slli_epi32(below, 16)));
    store(out.right, _mm256_or_si256(right, _mm256_slli_epi32(both, 16)));
    const __m256i row = _mm256_slli_epi32(_mm256_srli_epi32(y, kWeightBits), 16);
    store(out.at,
          _mm256_madd_epi16(_mm256_or_si256(_mm256_srli_epi32(x, kWeightBits), row), row_and_one));
    out.inside[i / 16] = std::uint16_t(i % 16 ? out.inside[i / 16] | in << 8 : in);
    found += __builtin_popcount(unsigned(in));
  }
#else
  for (int i = 0; i < count; ++i) {
    const ShadowTexels t = shadow_texels(place, {points[2 * i], points[2 * i + 1]});
    if (i % 16 == 0) out.inside[i / 16] = 0;
    out.inside[i / 16] |= std::uint16_t(t.inside << (i % 16));
    found += t.inside;
    out.at[i] = t.y * (place.size + 1) + t.x;
    out.left[i] = t.weight[0][0] | t.weight[1][0] << 16;
    out.right[i] = t.weight[0][1] | t.weight[1][1] << 16;
  }
#endif
  return found;
}

// Ratios at `count` places, a multiple of 4. Up to four floats more are written.
FASTIBL_TARGET void blend(const ShadowLookUp::Column* columns, const Places& places, int count,
                          float range, float* out) {
#if defined(FASTIBL_IN_AVX512)
  // Four points: two of them in a register, each with its left column and its right one.
  const __m512 unit = _mm512_set1_ps(kRatioUnit * range), half = _mm512_set1_ps(0.5f * range);
  const __m512i of_first = _mm512_setr_epi32(0, 0, 0, 0, 4, 4, 4, 4, 1, 1, 1, 1, 5, 5, 5, 5),
                of_last = _mm512_setr_epi32(2, 2, 2, 2, 6, 6, 6, 6, 3, 3, 3, 3, 7, 7, 7, 7);
  const __m512i lefts =
      _mm512_setr_epi32(0, 1, 2, 8, 9, 10, 16, 17, 18, 24, 25, 26, 24, 25, 26, 27);
  const __m512i rights = _mm512_add_epi32(lefts, _mm512_set1_epi32(4));
  const auto load = [columns](std::int32_t a, std::int32_t b) FASTIBL_TARGET {
    const __m256i first = _mm256_loadu_si256((const __m256i*)(columns + a)),
                  second = _mm256_loadu_si256((const __m256i*)(columns + b));
    return _mm512_inserti64x4(_mm512_castsi256_si512(first), second, 1);
  };
  for (int i = 0; i < count; i += 4, out += 12) {
    const __m512i weights =
        _mm512_castsi256_si512(_mm256_set_m128i(_mm_load_si128((const __m128i*)(places.right + i)),
                                                _mm_load_si128((const __m128i*)(places.left + i))));
    const __m512i a = _mm512_madd_epi16(load(places.at[i], places.at[i + 1]),
                                        _mm512_permutexvar_epi32(of_first, weights)),
                  b = _mm512_madd_epi16(load(places.at[i + 2], places.at[i + 3]),
                                        _mm512_permutexvar_epi32(of_last, weights));
    const __m512i sums = _mm512_add_epi32(_mm512_permutex2var_epi32(a, lefts, b),
                                          _mm512_permutex2var_epi32(a, rights, b));
    _mm512_storeu_ps(out, _mm512_fmadd_ps(_mm512_cvtepi32_ps(sums), unit, half));
  }
#elif defined(FASTIBL_IN_AVX2)
  const __m128 unit = _mm_set1_ps(kRatioUnit * range), half = _mm_set1_ps(0.5f * range);
  for (int i = 0; i < count; ++i, out += 3) {
    const auto* at = (const __m128i*)(columns + places.at[i]);
    const __m128i sums = _mm_add_epi32(_mm_madd_epi16(at[0], _mm_set1_epi32(places.left[i])),
                                       _mm_madd_epi16(at[1], _mm_set1_epi32(places.right[i])));
    _mm_storeu_ps(out, _mm_fmadd_ps(_mm_cvtepi32_ps(sums), unit, half));
  }
#else
  for (int i = 0; i < count; ++i, out += 3) {
    const ShadowLookUp::Column* at = columns + places.at[i];
    const auto low = [](std::int32_t v) { return std::int32_t(std::int16_t(v & 0xffff)); };
    const std::int32_t l = places.left[i], r = places.right[i];
    for (int c = 0; c < 3; ++c)
      out[c] = range * ratio_of_sum(low(l) * at[0].code[c][0] + (l >> 16) * at[0].code[c][1] +
                            low(r) * at[1].code[c][0] + (r >> 16) * at[1].code[c][1]);
  }
#endif
}

#undef FASTIBL_WITH_256
