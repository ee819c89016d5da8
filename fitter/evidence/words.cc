#include "fitter/evidence/words.h"

#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "fitter/evidence/refit.h"

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

std::string history_words(const Fit& fit) {
  std::set<std::string> effects;
  for (const Parameter& p : fit.model().parameters) {
    if (!is_foreseeable(p, fit.robot().joint_count()))
      effects.insert(label({p.effect, p.joints, {}}));
  }
  std::string list;
  for (const std::string& effect : effects) list += (list.empty() ? "" : ", ") + effect;
  return list + (effects.size() > 1 ? " depend" : " depends") +
         " on the arm's past: predictions and tables take its average, and held-out poses err by " +
         micrometre_words(fit.held_out_error().mean) + "; with the past known as it is here, by " +
         micrometre_words(fit.held_out_with_history().errors[0].mean);
}

}  // namespace armtrue
