#include <algorithm>
#include <cmath>

#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

class TransmissionPwl final : public Effect {
 public:
  TransmissionPwl()
      : Effect(
            {.id = "transmission_pwl",
             .summary = "any other periodic or local joint error, as a piecewise linear table",
             .bound =
                 "1e-2 rad, of a joint that slides 1e-2 m: the unified-calibration paper (KUKA "
                 "KR30-3); what repeats with the joint angle and is larger is an offset or a scale",
             .role = Role::kTable,
             .drives = DriveRule::kEach,
             .options = {{"spacing", "rad or m",
                          "distance between nodes, default from the number of poses, 0.026 rad "
                          "(1.5 deg) or 26 mm at the finest"}},
             .searched = {"spacing"}}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    EffectTerms terms;
    for (const int k : request.joints) {
      const std::string variable = "q" + std::to_string(k);
      const std::vector<double>& q = context.state.column(variable);
      const double spacing = request.options.value("spacing", default_spacing(q));
      if (!(spacing > 0.0)) throw ModelError("effect transmission_pwl: spacing must be positive");
      add_table(terms, k, motor_unit(context, k), q, with_margin(nodes_over(q, spacing, 3)));
    }
    return terms;
  }

  std::optional<EffectRequest> finer(const EffectContext& context,
                                     const EffectRequest& request) const override {
    EffectRequest result = request;
    double spacing = kFinestOfAll, present = 0.0;
    for (const int k : request.joints.empty() ? joints_of_bare_entry(context) : request.joints) {
      const std::vector<double>& q = context.state.column("q" + std::to_string(k));
      spacing = std::max(spacing, spacing_for(q, kRowsPerFineNode));
      present = std::max(present, request.options.value("spacing", default_spacing(q)));
    }
    if (spacing > kWorthwhile * present) return std::nullopt;
    result.options["spacing"] = spacing;
    return result;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result;
    const double rows = static_cast<double>(context.state.rows());
    for (int k = 1; k <= context.joint_count(); ++k) {
      const std::vector<double>& q = context.state.column("q" + std::to_string(k));
      const double travel = travel_of(q);
      // These are angles; a slide may be shorter than three of them and uses shares of its travel.
      const double unit = context.prismatic(k) ? travel / kTravelOfATable : 1.0;
      for (const double spacing : {0.349065850 * unit, 0.174532925 * unit, 0.0872664626 * unit}) {
        const bool supported = travel / spacing < rows / kRowsPerCandidateNode;
        if (travel > 3.0 * spacing && supported)
          result.push_back({id(), {k}, {{"spacing", spacing}}});
      }
    }
    return result;
  }

 private:
  static constexpr double kLargest = 1e-2;  // [rad or m]
  // Prior sigma of a node's value, in units of smoothness; wide, so that a large smooth shape is
  // not improbable (docs/decisions/0014).
  static constexpr double kValue = 16.0;
  // 1.5 deg: a search then takes the time for some thousand nodes; finer spacing gains real arms
  // some percent.
  static constexpr double kFinest = 0.02617993878;
  static constexpr double kFinestOfAll = 0.01163552835;  // 0.67 deg
  static constexpr double kMargin = 0.106;               // [rad], just over four cells of kFinest
  static constexpr double kRowsPerNode = 2.0;
  static constexpr double kRowsPerCandidateNode = 3.0;
  static constexpr double kRowsPerFineNode = 1.5;
  static constexpr double kTravelOfATable = 3.0;  // [rad]: the coarsest then has nine cells
  static constexpr double kWorthwhile = 0.8;      // of the present spacing

  // The priors of value and second difference determine the angle over which a table returns to
  // zero where no pose lies: √kValue cells. Cells below kFinest keep that angle, so that a finer
  // table bridges the same gaps.
  static double value_sigma(double spacing) {
    return kValue * std::pow(std::max(1.0, kFinest / spacing), 2);
  }

  static double travel_of(const std::vector<double>& q) {
    const auto [low, high] = std::minmax_element(q.begin(), q.end());
    return *high - *low;
  }

  // The spacing at which a node has so many rows.
  static double spacing_for(const std::vector<double>& q, double rows_per_node) {
    return travel_of(q) * rows_per_node / static_cast<double>(std::max<std::size_t>(q.size(), 1));
  }

  static double default_spacing(const std::vector<double>& q) {
    return std::max(kFinest, spacing_for(q, kRowsPerNode));
  }

  // Nodes beyond the data continue a table towards zero as the priors of smoothness and value
  // determine: a joint a few degrees outside the training range must not lose all its correction.
  static std::vector<double> with_margin(std::vector<double> nodes) {
    if (nodes.size() < 3) return nodes;
    const double spacing = nodes[1] - nodes[0];
    const auto count = static_cast<std::size_t>(kMargin / spacing);
    for (std::size_t i = 0; i < count; ++i) nodes.push_back(nodes.back() + spacing);
    for (std::size_t i = 0; i < count; ++i) nodes.insert(nodes.begin(), nodes.front() - spacing);
    return nodes;
  }

  void add_table(EffectTerms& terms, int joint, const std::string& unit,
                 const std::vector<double>& q, const std::vector<double>& nodes) const {
    if (nodes.size() < 3) return;  // a joint that never moves has no table
    const std::string variable = "q" + std::to_string(joint);
    TableReference table;
    table.id = parameter_name(id(), {joint}, "");
    table.axes = {{variable, nodes}};
    Penalty mean, slope;
    mean.sigma = slope.sigma = 1e-9;
    slope.only_with = parameter_name("joint_scale", {joint}, "");
    const std::size_t first = terms.parameters.size();
    const double spacing = nodes[1] - nodes[0];
    std::vector<double> hits(nodes.size(), 0.0);
    double mean_q = 0.0;
    for (const double v : q) {
      hits[static_cast<std::size_t>(std::lround((v - nodes.front()) / spacing))] +=
          1.0 / static_cast<double>(q.size());
      mean_q += v / static_cast<double>(q.size());
    }
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      Parameter& p = add(terms, {joint}, "node" + std::to_string(i + 1), unit, kLargest,
                         motor(joint), hat_expression(variable, nodes, i));
      p.terms.front().table = table;
      p.terms.front().table->index = {static_cast<int>(i)};
      mean.row.emplace_back(p.name, hits[i]);
      slope.row.emplace_back(p.name, hits[i] * (nodes[i] - mean_q));
      terms.penalties.push_back(value_penalty(p.name, value_sigma(spacing)));
    }
    terms.penalties.push_back(mean);
    terms.penalties.push_back(slope);
    for (std::size_t i = 1; i + 1 < nodes.size(); ++i) {
      const auto name = [&](std::size_t k) { return terms.parameters[first + k].name; };
      terms.penalties.push_back(curvature_penalty(name(i - 1), name(i), name(i + 1)));
    }
  }
};

const RegisterEffect<TransmissionPwl> registered_transmission_pwl;

}  // namespace
}  // namespace armtrue
