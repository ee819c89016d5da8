// Numbers exchanged with Python as NumPy arrays.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "fitter/model/state.h"

namespace armtrue {

using Vectors = nanobind::ndarray<nanobind::numpy, double, nanobind::ndim<2>>;

using Column =
    nanobind::ndarray<const double, nanobind::ndim<1>, nanobind::c_contig, nanobind::device::cpu>;

/// Copies columns for a state, which stores derived columns beside them.
inline State::Columns to_columns(const std::map<std::string, Column>& arrays) {
  State::Columns columns;
  for (const auto& [name, array] : arrays)
    columns[name].assign(array.data(), array.data() + array.shape(0));
  return columns;
}

/// An array of `width` columns from row-major values. Hands the memory over without copying.
inline Vectors to_numpy(std::vector<double> values, std::size_t width) {
  auto* owned = new std::vector<double>(std::move(values));
  const nanobind::capsule owner(
      owned, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return Vectors(owned->data(), {owned->size() / width, width}, owner);
}

}  // namespace armtrue
