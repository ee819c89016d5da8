#include "fitter/diagnose/extra_blocks.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "fitter/effects/tables.h"
#include "fitter/evidence/refit.h"

namespace armtrue {
namespace {

// Most spectral lines of one joint, including those in the model: more of them together can imitate
// a table.
constexpr std::size_t kSpectralPeaks = 3;
constexpr std::size_t kFineNodes = 30, kPairNodes = 7;
constexpr double kLowestLine = 2.5;        // lower counts are covered by harmonics and geometry
constexpr double kFewestSlideWaves = 2.0;  // fewest waves of a line over a sliding joint's travel

// The effect that causes a line of a joint's residual, as a request; nullopt if none does.
std::optional<EffectRequest> cause_of_line(const EffectContext& context, int joint, double cycles) {
  for (const Effect* effect : effect_catalogue()) {
    if (std::optional<EffectRequest> request = effect->as_line(context, joint, cycles))
      return request;
  }
  return std::nullopt;
}

bool has_count(const EffectRequest& request) {
  return request.options.contains("cycles") || request.options.contains("wavelengths");
}

// Number of spectral lines of a joint in the fitted model.
std::size_t lines_on(const Fit& fit, int joint) {
  return static_cast<std::size_t>(
      std::ranges::count_if(removable_effects(fit), [&](const EffectRequest& request) {
        return has_count(request) && request.joints == std::vector{joint};
      }));
}

// Whether the fitted model has waves of a joint whose counts follow from its gear ratio.
bool has_known_lines(const Fit& fit, int joint) {
  return std::ranges::any_of(removable_effects(fit), [&](const EffectRequest& request) {
    return !has_count(request) && request.joints == std::vector{joint} &&
           !find_effect(request.effect).tried_lines(fit.context(), joint).empty();
  });
}

// Whether some effect tries a line anyway for which `is_like(line, distance / resolution)` holds. A
// line and its alias on the joint's grid of positions count as the same.
template <typename IsLike>
bool is_tried(const Fit& fit, const JointSpectrum& spectrum, double cycles, const IsLike& is_like) {
  return std::ranges::any_of(effect_catalogue(), [&](const Effect* effect) {
    return std::ranges::any_of(
        effect->tried_lines(fit.context(), spectrum.joint), [&](double line) {
          const double away =
              std::min(std::abs(cycles - line), std::abs(cycles - spectrum.folded(line)));
          return is_like(line, away / spectrum.resolution);
        });
  });
}

// Fewest cycles of a line: less than about one wave over the joint's range is a bend that geometry
// and harmonics produce too.
double fewest_cycles(const JointSpectrum& spectrum) {
  return spectrum.slides ? kFewestSlideWaves * spectrum.resolution
                         : std::max(kLowestLine, spectrum.resolution);
}

// The counts of a peak to try as candidates. None if the residual cannot tell the peak from a line
// that some effect tries anyway, or if the model has such a line: a wave that is no pure sine
// leaves power there. Other errors can shift a peak, so the whole count that the joint's range
// cannot tell from it is tried too, and the search chooses.
std::vector<double> counts_of(const Fit& fit, const Linearization& linearization,
                              const JointSpectrum& spectrum, const SpectralPeak& peak) {
  constexpr double kSame = 1e-3, kNear = 0.5, kNearWhole = 0.3;
  if (is_tried(fit, spectrum, peak.cycles, [&](double line, double away) {
        return away < kNear && (has_known_lines(fit, peak.joint) ||
                                !is_told_from(peak, line, linearization, fit.state()));
      }))
    return {};
  const double whole = std::round(peak.cycles);
  if (spectrum.slides || whole == peak.cycles ||
      std::abs(peak.cycles - whole) > kNearWhole * spectrum.resolution ||
      is_tried(fit, spectrum, whole, [](double, double away) { return away < kSame; }))
    return {peak.cycles};
  return {peak.cycles, whole};
}

// A line as a candidate; nullopt if no effect causes it or the fit already has it.
std::optional<EvidenceBlock> line_block(const Fit& fit, int joint, double cycles) {
  const std::optional<EffectRequest> cause = cause_of_line(fit.context(), joint, cycles);
  if (!cause) return std::nullopt;
  EvidenceBlock block;
  block.request = *cause;
  block.forms = {EvidenceForm(make_block(fit.context(), block.request))};
  const auto& parameters = block.forms.front().block.terms.parameters;
  if (std::ranges::any_of(parameters,
                          [&](const Parameter& p) { return fit.model().index(p.name) >= 0; }))
    return std::nullopt;
  block.label = label(block.request);
  block.kind = block.request.effect;
  return block;
}

// The nodes of a variable, dense enough to follow a step.
std::vector<double> fine_nodes(const State& state, const std::string& variable, std::size_t count) {
  const std::vector<double>& values = state.column(variable);
  const std::set<double> distinct(values.begin(), values.end());
  if (distinct.size() <= count) return {distinct.begin(), distinct.end()};
  return nodes_over(values, 1e9, count);
}

// A finding as a smooth function with nodes on all its variables.
Block smooth_block(const Fit& fit, const StructureFinding& finding) {
  const bool single = finding.variables.size() == 1;
  TableReference table;
  table.id = "structure";
  const std::size_t count = finding.nodes > 0 ? finding.nodes : single ? kFineNodes : kPairNodes;
  for (const std::string& variable : finding.variables)
    table.axes.push_back({variable, fine_nodes(fit.state(), variable, count)});
  Block block{finding.block.request, {}, 0};
  const Term like = finding.block.terms.parameters.front().terms.front();
  const std::size_t inner = single ? 1 : table.axes[1].nodes.size();
  for (std::size_t i = 0; i < table.axes[0].nodes.size() * inner; ++i) {
    Parameter p = finding.block.terms.parameters.front();
    std::string basis = hat_expression(table.axes[0].variable, table.axes[0].nodes, i / inner);
    table.index = {static_cast<int>(i / inner)};
    if (!single) {
      basis += "*" + hat_expression(table.axes[1].variable, table.axes[1].nodes, i % inner);
      table.index.push_back(static_cast<int>(i % inner));
    }
    p.terms = {like};
    p.terms.front().basis = Expression::parse(basis);
    p.terms.front().table = table;
    block.terms.parameters.push_back(std::move(p));
  }
  return block;
}

}  // namespace

std::vector<EvidenceBlock> spectral_blocks(const Fit& fit, const Linearization& linearization,
                                           const std::vector<JointSpectrum>& spectra) {
  std::vector<EvidenceBlock> result;
  double lines = 0.0;
  for (const JointSpectrum& spectrum : spectra) {
    const std::size_t standing = lines_on(fit, spectrum.joint);
    if (standing >= kSpectralPeaks) continue;
    lines += static_cast<double>(spectrum.cycles.size()) / 4.0;
    for (const SpectralPeak& peak :
         highest_peaks(spectrum, linearization, fit.state(), kSpectralPeaks - standing)) {
      if (peak.cycles < fewest_cycles(spectrum)) continue;
      for (const double cycles : counts_of(fit, linearization, spectrum, peak)) {
        if (std::optional<EvidenceBlock> block = line_block(fit, spectrum.joint, cycles))
          result.push_back(std::move(*block));
      }
    }
  }
  for (EvidenceBlock& block : result) block.tried = lines;
  return result;
}

std::vector<EvidenceBlock> structure_blocks(const Fit& fit, const Structure& structure) {
  std::vector<EvidenceBlock> result;
  for (std::size_t f = 0; f < structure.findings.size(); ++f) {
    const StructureFinding& finding = structure.findings[f];
    EvidenceBlock block;
    block.request = finding.block.request;
    block.label = "structure";
    block.kind = "structure";
    block.structure = true;
    block.finding = f;
    block.is_cause = finding.tried > 0;
    // A function of two variables can contain two causes, one in each variable: its prior odds are
    // those of two.
    block.tried = std::pow(static_cast<double>(finding.tried > 0 ? finding.tried : structure.tried),
                           static_cast<double>(finding.variables.size()));
    block.forms = {EvidenceForm(finding.has_own_form ? finding.block : smooth_block(fit, finding))};
    result.push_back(std::move(block));
  }
  return result;
}

}  // namespace armtrue
