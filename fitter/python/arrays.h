// Figures that cross into Python as NumPy arrays.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <utility>
#include <vector>

namespace armtrue {

using Vectors = nanobind::ndarray<nanobind::numpy, double, nanobind::ndim<2>>;

/// An array of `width` columns out of values row by row. Hands the memory over without copying.
inline Vectors to_numpy(std::vector<double> values, std::size_t width) {
  auto* owned = new std::vector<double>(std::move(values));
  const nanobind::capsule owner(
      owned, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return Vectors(owned->data(), {owned->size() / width, width}, owner);
}

}  // namespace armtrue
