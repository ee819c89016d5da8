// The sampler behind search_blocks(): one state, changed block by block.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "fitter/evidence/search/conditional.h"
#include "fitter/evidence/search/elimination.h"
#include "fitter/evidence/search/search.h"

namespace armtrue {

class Sampler {
 public:
  Sampler(const SearchProblem& problem, const SearchOptions& options)
      : problem_(problem),
        options_(options),
        generator_(options.seed),
        state_(problem.blocks.size()),
        eliminated_(problem.gram, problem.gradient, problem.squares) {}

  SearchResult run();

 private:
  const SearchBlock& block(std::size_t b) const { return problem_.blocks[b]; }
  Eigen::MatrixXd factor(std::size_t b, const Choice& c) const {
    const PriorShape& shape = block(b).shapes[static_cast<std::size_t>(c.shape)];
    return shape.scale[static_cast<std::size_t>(c.scale)] * shape.spread;
  }
  Elimination::Local without(std::size_t b) const {
    return state_[b].is_present() ? eliminated_.without(b)
                                  : eliminated_.beside(block(b).first, block(b).width);
  }
  Conditional conditional(std::size_t b) const {
    return weigh_choices(problem_, block(b), without(b));
  }
  void set(std::size_t b, const Choice& c);
  void go_to(const std::vector<Choice>& wanted);
  void line_up();
  std::vector<Conditional> conditionals(const std::vector<std::size_t>& blocks) const;
  double best_change(std::vector<std::size_t>& looked_at, std::size_t& at, Choice& to) const;
  void size_present();
  void climb(const std::vector<std::size_t>& allowed);
  void find_readings();
  // One explanation of the data: blocks, and sizes that suit them together.
  struct Side {
    std::vector<std::size_t> members;
    std::vector<Choice> likely;
    void add(std::size_t b, const Choice& size) {
      members.push_back(b);
      likely.push_back(size);
    }
  };
  // Two alternative explanations: blocks of the likeliest set, and blocks that replace them. A
  // block whose size differs between the two is in both.
  struct Reading {
    Side one, other;
  };
  double weigh(const Side& side, std::vector<Choice>& sizes);
  void take_out(const Side& side);
  bool stands(const Side& side, const Side& other) const;
  void read_otherwise(const Reading& reading);
  bool has_stranger() const;
  void walk(std::uint64_t seed);
  void sweep(int number, bool count);
  void exchange();
  Choice draw(const Conditional& conditional);
  double log_posterior() const;
  void remember();
  void describe_alone(SearchResult& result) const;
  Eigen::MatrixXd beyond_each_other(const std::vector<Eigen::MatrixXd>& alone,
                                    const SearchResult& result) const;
  void describe(SearchResult& result);

  const SearchProblem& problem_;
  const SearchOptions& options_;
  std::mt19937_64 generator_;
  std::vector<Choice> state_, best_;
  std::vector<Reading> readings_;
  double best_posterior_ = -std::numeric_limits<double>::infinity();
  Elimination eliminated_;
  std::vector<double> inclusion_, visits_, last_;  // last_: probability at the last visit
  std::vector<bool> strange_;                      // improbable when it last entered
  double nothing_ = 0.0, counted_ = 0.0;
};

}  // namespace armtrue
