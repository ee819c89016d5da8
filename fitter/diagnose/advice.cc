#include "fitter/diagnose/advice.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "fitter/diagnose/diagnose.h"

namespace armtrue {
namespace {

// What a candidate's terms read: the way to tell two apart is to change what only one of them
// reads.
struct Reads {
  bool load = false, direction = false, temperature = false, time = false;
};

Reads reads_of(const Candidate& candidate) {
  Reads reads;
  for (const Parameter& p : candidate.parameters) {
    for (const Term& term : p.terms) {
      for (const std::string& v : term.basis.variables()) {
        reads.load = reads.load || v == "payload" || v.starts_with("tau") || v.starts_with("gm") ||
                     v.starts_with("bm") || v.starts_with("u");
        reads.direction = reads.direction || v.starts_with("dir");
        reads.temperature = reads.temperature || v.starts_with("dT");
        reads.time = reads.time || v == "time";
      }
    }
  }
  return reads;
}

std::string how_to_tell(const Candidate& a, const Candidate& b) {
  const Reads ra = reads_of(a), rb = reads_of(b);
  if (ra.load != rb.load)
    return "measure the same poses with another payload: only one of them follows the load";
  if (ra.direction != rb.direction)
    return "reach the same poses from the other side: only one of them follows the direction of "
           "approach";
  if (ra.temperature != rb.temperature)
    return "measure the same poses at another temperature: only one of them follows it";
  if (ra.time != rb.time)
    return "repeat early poses at the end of the session: only one of them follows time";
  return "armtrue plan chooses poses that separate them best";
}

// "joint 2: 8, 16.1 and 24 cycles a turn": the periods that a table stands for, strongest first.
std::string periods_of(const JointSpectrum& spectrum) {
  constexpr double kLowest = 2.5, kWorthNaming = 0.01;
  std::vector<std::pair<double, double>> peaks;
  for (std::size_t i = 1; i + 1 < spectrum.power.size(); ++i) {
    const bool top =
        spectrum.power[i] >= spectrum.power[i - 1] && spectrum.power[i] > spectrum.power[i + 1];
    if (top && spectrum.cycles[i] > kLowest && spectrum.power[i] > kWorthNaming) {
      peaks.emplace_back(spectrum.power[i], spectrum.cycles[i]);
    }
  }
  std::sort(peaks.rbegin(), peaks.rend());
  std::string list;
  for (std::size_t k = 0; k < peaks.size() && k < 3; ++k) {
    char number[16];
    std::snprintf(number, sizeof number, "%.3g", peaks[k].second);
    list += (list.empty() ? "" : ", ") + std::string(number);
  }
  return list.empty() ? ""
                      : "joint " + std::to_string(spectrum.joint) + ": " + list + " cycles a turn";
}

void advise_periods(const Diagnosis& d, const Candidate& table, std::vector<std::string>& advice) {
  std::string all;
  for (const JointSpectrum& spectrum : d.spectra) {
    const auto& joints = table.request.joints;
    if (std::find(joints.begin(), joints.end(), spectrum.joint) == joints.end()) continue;
    const std::string periods = periods_of(spectrum);
    if (!periods.empty()) all += (all.empty() ? "" : "; ") + periods;
  }
  if (!all.empty()) {
    advice.push_back("the joint error that the table stands for repeats (" + all +
                     "): neither gravity nor low harmonics");
  }
}

void advise_missing(const Diagnosis& d, std::vector<std::string>& advice) {
  const Candidate& best = *d.recommended();
  std::string joints;
  for (const int k : best.request.joints)
    joints += (joints.empty() ? " --joints " : ",") + std::to_string(k);
  advice.push_back("add it: armtrue add FIT " + best.request.effect + joints + " --out FIT2");
  if (best.request.options.contains("cycles")) {
    advice.push_back(best.request.options["cycles"].dump() + " cycles a turn on joint " +
                     std::to_string(best.request.joints.front()) +
                     ": look for a gear or bearing of that count");
  }
  if (find_effect(best.request.effect).generic()) advise_periods(d, best, advice);
  for (const Candidate& other : d.candidates) {
    if (&other == &best) continue;
    const auto& set = best.confounded_with;
    if (std::find(set.begin(), set.end(), label(other.request)) == set.end()) continue;
    const double lead = other.confirmed ? other.delta_bic - best.delta_bic
                                        : other.score.delta_bic - best.score.delta_bic;
    const std::string verdict =
        lead > 10.0 ? ": this data prefers the first, but the second explains nearly as much; "
                    : ": this data cannot tell; ";
    advice.push_back(label(best.request) + " or " + label(other.request) + verdict +
                     how_to_tell(best, other));
    if (advice.size() >= 6) break;
  }
}

void advise_structure(const Diagnosis& d, const Fit& fit, std::vector<std::string>& advice) {
  for (const StructureFinding& f : d.unexplained) {
    std::string what;
    for (const std::string& v : f.variables) what += (what.empty() ? "" : " and ") + v;
    advice.push_back("what is left depends on " + what + " and acts like " + f.coordinate + ": " +
                     f.shape);
    break;
  }
  if (d.unexplained.empty()) {
    advice.push_back("what is left is more than the " + d.lack_of_fit.against +
                     " allow and depends on no recorded variable");
    std::set<std::string> columns;
    for (const Untestable& u : d.untestable) columns.insert(u.needs.begin(), u.needs.end());
    std::string list;
    for (const std::string& c : columns) list += (list.empty() ? "" : ", ") + c;
    if (!list.empty()) advice.push_back("record next: " + list);
  } else {
    advice.push_back(
        "no effect of the catalogue has that form: write it as a custom effect, or as generic "
        "remedies add transmission_pwl "
        "on the joints named, then residual_grid");
  }
  if (d.neighbour_ratio < 0.7)
    advice.push_back("neighbouring poses err alike: it repeats and can be compensated");
  (void)fit;
}

}  // namespace

std::vector<std::string> advise(const Diagnosis& d, const Fit& fit) {
  std::vector<std::string> advice;
  if (d.verdict == Verdict::kMissingEffect) advise_missing(d, advice);
  if (d.verdict == Verdict::kUnexplainedStructure) advise_structure(d, fit, advice);
  if (d.verdict == Verdict::kNothingMissing)
    advice.push_back("nothing to add: what is left is noise as far as these data can tell");
  std::string untestable;
  for (const Untestable& u : d.untestable)
    untestable += (untestable.empty() ? "" : ", ") + u.effect;
  if (!untestable.empty())
    advice.push_back("not testable with the recorded columns: " + untestable);
  return advice;
}

}  // namespace armtrue
