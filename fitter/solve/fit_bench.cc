// Duration of a fit and of its parts, and its growth with the number of rows. Run by `./dev bench`.
#include <benchmark/benchmark.h>

#include <nlohmann/json.hpp>

#include "fitter/solve/fit.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;

// Six axes with masses, full geometry and two springs: 47 columns, of which the data determine 29.
json compliant_model() {
  json model = testing::geometry_model();
  model["effects"].push_back("joint_compliance");
  return model;
}

Problem problem(std::size_t rows) {
  testing::Random random(7);
  json robot = testing::industrial_arm();
  testing::add_links(random, robot);
  return Problem(robot, compliant_model(), {rows, false, 1, 1e-5, 2e-5, {}}, random,
                 [&](const Parameter& p) {
                   if (p.effect == "joint_compliance") return 2e-6;
                   if (p.effect == "base_frame" || p.effect == "tool_offset") return 0.0;
                   return testing::normal(random, p.unit == "m" ? 2e-4 : 5e-4);
                 });
}

void fit(benchmark::State& state, bool cross_validate) {
  const Problem p = problem(static_cast<std::size_t>(state.range(0)));
  const ModelSpecification specification = ModelSpecification::from_json(compliant_model());
  FitOptions options;
  options.cross_validate = cross_validate;
  for (auto _ : state)
    benchmark::DoNotOptimize(Fit::run(p.robot, p.columns, specification, options));
  state.SetComplexityN(state.range(0));
}

void Fit_(benchmark::State& state) { fit(state, false); }
void FitWithHeldOutErrors(benchmark::State& state) { fit(state, true); }
BENCHMARK(Fit_)
    ->Name("Fit")
    ->Arg(300)
    ->Arg(1000)
    ->Arg(10000)
    ->Arg(100000)
    ->Unit(benchmark::kMillisecond)
    ->Complexity(benchmark::oN);
BENCHMARK(FitWithHeldOutErrors)->Arg(300)->Unit(benchmark::kMillisecond);

void Align(benchmark::State& state) {
  const Problem p = problem(300);
  for (auto _ : state) benchmark::DoNotOptimize(align(*p.state, p.measurements));
}
BENCHMARK(Align)->Unit(benchmark::kMillisecond);

void BuildDesign(benchmark::State& state) {
  const Problem p = problem(300);
  for (auto _ : state) benchmark::DoNotOptimize(p.make_design());
}
BENCHMARK(BuildDesign)->Unit(benchmark::kMillisecond);

// One pass over all rows: kinematics, Jacobian, whitening. Its least possible cost is counted
// in tests/speed/fit_speed.py.
void Evaluate(benchmark::State& state) {
  const Problem p = problem(300);
  Design design = p.make_design();
  Design::Row row;
  for (auto _ : state) {
    for (std::size_t i = 0; i < design.rows(); ++i) design.evaluate(i, true, row);
    benchmark::DoNotOptimize(row.residual);
  }
}
BENCHMARK(Evaluate)->Unit(benchmark::kMillisecond);

void Accumulate(benchmark::State& state) {
  const Problem p = problem(300);
  Design design = p.make_design();
  for (auto _ : state) benchmark::DoNotOptimize(accumulate(design));
}
BENCHMARK(Accumulate)->Unit(benchmark::kMillisecond);

void Identify(benchmark::State& state) {
  const Problem p = problem(300);
  Design design = p.make_design();
  for (auto _ : state) benchmark::DoNotOptimize(identify(design));
}
BENCHMARK(Identify)->Unit(benchmark::kMillisecond);

void Solve(benchmark::State& state) {
  const Problem p = problem(300);
  Design design = p.make_design();
  design.set_free(identify(design).kept);
  const std::vector<double> start(static_cast<std::size_t>(design.unknowns()), 0.0);
  for (auto _ : state) {
    design.set_unknowns(start.data());
    benchmark::DoNotOptimize(solve(design, 1e-4));
  }
}
BENCHMARK(Solve)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace armtrue
