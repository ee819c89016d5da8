#include "fitter/evidence/prior_shapes.h"

#include <gtest/gtest.h>

namespace armtrue {
namespace {

// A form of two coefficients, each of which moves the tool by a millimetre.
EvidenceForm form_of(const Parameter& first, const Parameter& second) {
  Block block;
  block.terms.parameters = {first, second};
  return EvidenceForm(std::move(block));
}

std::vector<PriorShape> shapes_of(const EvidenceForm& form, double known_size = 0.0) {
  std::vector<PriorShape> shapes;
  add_shapes(form, Eigen::VectorXd::Constant(2, 1e-3), known_size, 1, 4, shapes);
  return shapes;
}

double largest_scale(const std::vector<PriorShape>& shapes) {
  double largest = 0.0;
  for (const PriorShape& shape : shapes)
    largest = std::max(largest, shape.units.maxCoeff() * shape.scale.back());
  return largest;
}

TEST(PriorShapes, CoefficientOfKnownSign_HasASignRule) {
  Parameter lags, either;
  lags.sign = -1;
  lags.sign_doubt = 0.05;
  for (const PriorShape& shape : shapes_of(form_of(either, lags))) {
    ASSERT_EQ(shape.signs.size(), 1u);
    EXPECT_EQ(shape.signs.front().along, Eigen::Vector2d(0.0, -1.0));
    EXPECT_EQ(shape.signs.front().doubt, 0.05);
  }
}

// If the prior makes two coefficients nearly equal, a sign rule for one covers both.
TEST(PriorShapes, AlikeCoefficients_HaveOneSignRule) {
  Parameter spring;
  spring.sign = 1;
  spring.alike = true;
  std::size_t alike = 0;
  for (const PriorShape& shape : shapes_of(form_of(spring, spring))) {
    const bool is_diagonal = shape.units(0, 1) == 0.0 && shape.units(1, 0) == 0.0;
    EXPECT_EQ(shape.signs.size(), is_diagonal ? 2u : 1u);
    alike += is_diagonal ? 0 : 1;
  }
  EXPECT_EQ(alike, 1u);
}

TEST(PriorShapes, SpreadIsZeroOutsideTheColumnsOfTheForm) {
  for (const PriorShape& shape : shapes_of(form_of({}, {}))) {
    ASSERT_EQ(shape.spread.rows(), 4);
    EXPECT_EQ(shape.spread.row(0).norm() + shape.spread.row(3).norm(), 0.0);
    EXPECT_EQ(shape.spread.middleRows(1, 2), shape.units);
  }
}

// The largest prior is 2.5 mm, unless a fitted coefficient moves the tool by more.
TEST(PriorShapes, LargestScaleGrowsWithFittedCoefficients) {
  EXPECT_NEAR(largest_scale(shapes_of(form_of({}, {}))), 2.5, 1e-12);
  EXPECT_NEAR(largest_scale(shapes_of(form_of({}, {}), 8e-3)), 8.0, 1e-12);
}

// A bound is two standard deviations.
TEST(PriorShapes, BoundedCoefficient_LargestScaleIsHalfItsBound) {
  Parameter bounded;
  bounded.bound = 0.5;
  EXPECT_NEAR(largest_scale(shapes_of(form_of(bounded, bounded))), 0.25, 1e-12);
}

}  // namespace
}  // namespace armtrue
