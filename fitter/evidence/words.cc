#include "fitter/evidence/words.h"

#include <cstdio>
#include <nlohmann/json.hpp>

namespace armtrue {

std::string number_words(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

std::string list_words(const nlohmann::json& values) {
  std::string text;
  for (const auto& value : values) {
    text += text.empty() ? "[" : ",";
    text += value.is_string() ? value.get<std::string>() : number_words(value.get<double>());
  }
  return text + "]";
}

std::string micrometre_words(double metres) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f um", metres * 1e6);
  return text;
}

}  // namespace armtrue
