// The adapter's loop over time steps in C++: Pinocchio's tree and closures, the forces for which Pinocchio has no element, and the
// integration methods, without Python in between.
//
// A C++ user of Pinocchio would write such a program against the library in the wheel `pin`. `compiled.py` fills a Linkage with the
// numbers of the model that the adapter has built and verified, and calls `advance` or `advance_adaptive` from sample to sample.
//
// Alignment: the library in the wheel was compiled for any processor, so it expects Eigen's objects at multiples of 16 bytes. With
// -march=native this file would align them otherwise, and each side would read the other's fields in the wrong places.

#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/proximal.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace pin = pinocchio;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

static_assert(EIGEN_MAX_ALIGN_BYTES == 16, "the library of the wheel aligns to 16 bytes");

// A point fixed in the frame of a joint; joint 0 is the ground.
struct Point
{
  int joint;
  Vector2d local;
};

// Two points and the force -k (x - rest) - c x' + bias along a coordinate x between them: their distance, or, with an `axis`, the
// displacement of b from a along a direction that is fixed in the frame of a's joint.
struct Spring
{
  Point a, b;
  bool has_axis;
  Vector2d axis;
  double k, c, rest, bias;
};

// A constant force at a point; its vector is fixed in the frame of the joint `frame`.
struct Push
{
  Point at;
  int frame;
  Vector2d value;
};

// Position and orientation of a joint's frame in the plane.
struct Frame
{
  Vector2d origin;
  double cosine, sine;

  Vector2d turned(const Vector2d & x) const { return {cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1]}; }
  Vector2d world(const Vector2d & x) const { return origin + turned(x); }
};

// A joint with one coordinate.
struct Planar
{
  Frame placement;  // in the frame of the parent joint
  bool turns;       // about z; otherwise the joint is a slide
  Vector2d axis;    // direction of a slide, in the frame `placement`
};

// Coefficients of DOP853 in scipy's form: for the `stages` of a step, and for four further evaluations for its dense output.
struct Tableau
{
  static constexpr int stages = 12, all = 16, powers = 7;
  double a[all][all], b[stages], e5[stages + 1], e3[stages + 1], d[powers - 3][all];
};

// Thrown if accelerations violate the constraints or are not finite.
struct Failure
{
};

struct Linkage
{
  pin::Model model;
  pin::Data data;
  std::vector<pin::RigidConstraintModel> closures;
  std::vector<pin::RigidConstraintData> closure_data;
  pin::ProximalSettings proximal;
  double solved = 0.0;  // largest residual of the constraints, relative to the largest acceleration

  std::vector<Planar> joints;
  std::vector<Frame> frames;
  std::vector<Spring> springs;
  std::vector<Push> pushes;
  VectorXd constant, tau;
  Eigen::MatrixXd stiffness, damping;
  bool has_stiffness = false, has_damping = false;

  long evaluations = 0;
  VectorXd y, dy;          // the state of a run
  VectorXd trial, speeds_after;  // positions of a stage, and velocities at the end of a step
  VectorXd a1, a2, a3, a4, v2, v3, v4;
  std::vector<VectorXd> velocities, accelerations;  // of the stages of DOP853

  // Compute the joints' frames at the coordinates `at`, which only springs and pushes need. Kinematics in the plane take a tenth of
  // the time of Pinocchio's, which are in space.
  void place(const VectorXd & at)
  {
    for (size_t k = 1; k < joints.size(); ++k)
    {
      const Planar & joint = joints[k];
      const Frame & parent = frames[model.parents[k]];
      const Frame & own = joint.placement;
      const double c = parent.cosine * own.cosine - parent.sine * own.sine;
      const double s = parent.sine * own.cosine + parent.cosine * own.sine;
      const double x = at[k - 1];
      Frame & frame = frames[k];
      frame.origin = parent.world(own.origin);
      if (joint.turns)
      {
        const double cx = std::cos(x), sx = std::sin(x);
        frame.cosine = c * cx - s * sx;
        frame.sine = s * cx + c * sx;
      }
      else
      {
        frame.cosine = c;
        frame.sine = s;
        frame.origin += x * frame.turned(joint.axis);
      }
    }
  }

  // Return the velocity of the point of a joint's body that is at `world`.
  Vector2d velocity(int joint, const Vector2d & world, const VectorXd & speeds) const
  {
    Vector2d sum = Vector2d::Zero();
    for (int k = joint; k > 0; k = model.parents[k])
    {
      const Frame & frame = frames[k];
      const Vector2d arm = world - frame.origin;
      sum += speeds[k - 1] * (joints[k].turns ? Vector2d(-arm[1], arm[0]) : frame.turned(joints[k].axis));
    }
    return sum;
  }

  // Add J^T force to tau, for a force on a joint's body at the point `world`.
  void push(int joint, const Vector2d & world, const Vector2d & force)
  {
    for (int k = joint; k > 0; k = model.parents[k])
    {
      const Frame & frame = frames[k];
      const Vector2d arm = world - frame.origin;
      tau[k - 1] += joints[k].turns ? arm[0] * force[1] - arm[1] * force[0] : frame.turned(joints[k].axis).dot(force);
    }
  }

  void push(const Spring & spring, const VectorXd & speeds)
  {
    const Vector2d b = frames[spring.b.joint].world(spring.b.local);
    const Vector2d from = frames[spring.a.joint].world(spring.a.local);
    Vector2d direction = spring.has_axis ? frames[spring.a.joint].turned(spring.axis) : Vector2d(b - from);
    double x = direction.dot(b - from);
    if (!spring.has_axis)
    {
      x = direction.norm();
      direction /= x;
    }
    // If the axis is fixed in a's body, the reaction on this body acts at the point b too, so that its moment is right.
    const Vector2d a = spring.has_axis ? b : from;
    const double rate = direction.dot(velocity(spring.b.joint, b, speeds) - velocity(spring.a.joint, a, speeds));
    const Vector2d force = (spring.bias - spring.k * (x - spring.rest) - spring.c * rate) * direction;
    push(spring.b.joint, b, force);
    push(spring.a.joint, a, -force);
  }

  const VectorXd & acceleration(const VectorXd & at, const VectorXd & speeds)
  {
    ++evaluations;
    tau = constant;
    if (has_damping)
      tau.noalias() += damping * speeds;
    if (has_stiffness)
      tau.noalias() += stiffness * at;
    if (!springs.empty() || !pushes.empty())
    {
      place(at);
      for (const Spring & spring : springs)
        push(spring, speeds);
      for (const Push & p : pushes)
        push(p.at.joint, frames[p.at.joint].world(p.at.local), frames[p.frame].turned(p.value));
    }
    const VectorXd & a = pin::constraintDynamics(model, data, at, speeds, tau, closures, closure_data, proximal);
    // mu times the last change of the constraint forces is the residual of the constraints, as in dynamics.py
    const double missed = proximal.mu * proximal.relative_residual;
    if (!(missed <= solved) && !(missed <= solved * std::max(1.0, a.cwiseAbs().maxCoeff())))
      fail(at, speeds);
    return a;
  }

  // Store the state without valid accelerations in y, dy, and throw; the adapter finds the reason from this state.
  [[noreturn]] void fail(const VectorXd & at, const VectorXd & speeds)
  {
    const VectorXd copy_at = at, copy_speeds = speeds;  // they may be y and dy themselves
    y = copy_at;
    dy = copy_speeds;
    throw Failure();
  }

  void rk4(double h)
  {
    a1 = acceleration(y, dy);
    trial = y + h / 2 * dy;
    v2 = dy + h / 2 * a1;
    a2 = acceleration(trial, v2);
    trial = y + h / 2 * v2;
    v3 = dy + h / 2 * a2;
    a3 = acceleration(trial, v3);
    trial = y + h * v3;
    v4 = dy + h * a3;
    a4 = acceleration(trial, v4);
    y += h / 6 * (dy + 2 * v2 + 2 * v3 + v4);
    dy += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }

  void semi_implicit_euler(double h)
  {
    dy += h * acceleration(y, dy);
    y += h * dy;
  }

  // Compute the rates of the stages `first` to `end` - 1 of a step h from y, dy.
  void stages(const Tableau & tableau, double h, int first, int end)
  {
    for (int k = first; k < end; ++k)
    {
      trial = y;
      velocities[k] = dy;  // a stage's velocity is the rate of its position
      for (int j = 0; j < k; ++j)
        if (const double weight = h * tableau.a[k][j]; weight != 0.0)
        {
          trial.noalias() += weight * velocities[j];
          velocities[k].noalias() += weight * accelerations[j];
        }
      accelerations[k] = acceleration(trial, velocities[k]);
    }
  }

  // Compute the state to_y, to_dy at the end of a step from the rates of its stages.
  void end_of_step(const Tableau & tableau, double h, VectorXd & to_y, VectorXd & to_dy) const
  {
    to_y = y;
    to_dy = dy;
    for (int k = 0; k < Tableau::stages; ++k)
      if (const double weight = h * tableau.b[k]; weight != 0.0)
      {
        to_y.noalias() += weight * velocities[k];
        to_dy.noalias() += weight * accelerations[k];
      }
  }

  void dop853_fixed(const Tableau & tableau, double h)
  {
    stages(tableau, h, 0, Tableau::stages);
    end_of_step(tableau, h, trial, speeds_after);
    y.swap(trial);
    dy.swap(speeds_after);
  }
};

static Vector2d pair(const double * x) { return {x[0], x[1]}; }

// Return the SE3 that three numbers of a translation and nine of a rotation, row by row, describe.
static pin::SE3 placement(const double * x)
{
  return pin::SE3(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(x + 3), Eigen::Map<const Vector3d>(x));
}

static double scaled_square(const VectorXd & x, const VectorXd & scale) { return x.cwiseQuotient(scale).squaredNorm(); }

// DOP853 with scipy's choice of steps, so that a compiled run takes the steps of a run from Python. Source: Hairer, Norsett and
// Wanner I, section II.4, and the program DOP853.
struct Adaptive
{
  Linkage & linkage;
  const Tableau & tableau;
  const double relative, absolute;
  VectorXd next_y, next_dy, scale_y, scale_dy, e5_y, e5_dy, e3_y, e3_dy;

  double root_mean_square(const VectorXd & of_y, const VectorXd & of_dy) const
  {
    return std::sqrt((scaled_square(of_y, scale_y) + scaled_square(of_dy, scale_dy)) / (2.0 * of_y.size()));
  }

  void scale(const VectorXd & y, const VectorXd & dy, const VectorXd & other_y, const VectorXd & other_dy)
  {
    scale_y = (absolute + relative * y.array().abs().max(other_y.array().abs())).matrix();
    scale_dy = (absolute + relative * dy.array().abs().max(other_dy.array().abs())).matrix();
  }

  // Return the first step size: an explicit Euler step of this size is small, and so is the effect of second derivatives.
  double first_step(double length)
  {
    Linkage & l = linkage;
    scale(l.y, l.dy, l.y, l.dy);
    const double d0 = root_mean_square(l.y, l.dy), d1 = root_mean_square(l.dy, l.accelerations[0]);
    const double h0 = std::min(d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1, length);
    next_y = l.y + h0 * l.dy;
    next_dy = l.dy + h0 * l.accelerations[0];
    e5_dy = l.acceleration(next_y, next_dy) - l.accelerations[0];
    const double d2 = root_mean_square(next_dy - l.dy, e5_dy) / h0;
    const double h1 = d1 <= 1e-15 && d2 <= 1e-15 ? std::max(1e-6, h0 * 1e-3) : std::pow(0.01 / std::max(d1, d2), 1.0 / 8);
    return std::min({100 * h0, h1, length});
  }

  double error(double h)
  {
    const Linkage & l = linkage;
    scale(l.y, l.dy, next_y, next_dy);
    for (VectorXd * x : {&e5_y, &e5_dy, &e3_y, &e3_dy})
      x->setZero(l.y.size());
    for (int k = 0; k < Tableau::stages; ++k)
    {
      e5_y += tableau.e5[k] * l.velocities[k];
      e5_dy += tableau.e5[k] * l.accelerations[k];
      e3_y += tableau.e3[k] * l.velocities[k];
      e3_dy += tableau.e3[k] * l.accelerations[k];
    }
    const double fifth = scaled_square(e5_y, scale_y) + scaled_square(e5_dy, scale_dy);
    const double third = scaled_square(e3_y, scale_y) + scaled_square(e3_dy, scale_dy);
    return fifth == 0 && third == 0 ? 0.0 : h * fifth / std::sqrt((fifth + 0.01 * third) * 2.0 * l.y.size());
  }

  // Return the state at the fraction x of the step that was just taken, which began at `before` (dense output).
  static VectorXd inside(double x, const VectorXd & before, const std::vector<VectorXd> & powers)
  {
    VectorXd sum = VectorXd::Zero(before.size());
    for (int k = 0; k < Tableau::powers; ++k)
    {
      sum += powers[Tableau::powers - 1 - k];
      sum *= k % 2 == 0 ? x : 1 - x;
    }
    return before + sum;
  }

  // Return the coefficients of the dense output of a step from `before` to `after`, for the function `inside`.
  std::vector<VectorXd> polynomial(const std::vector<VectorXd> & rates, const VectorXd & before, const VectorXd & after, double h)
  {
    std::vector<VectorXd> powers(Tableau::powers);
    const VectorXd change = after - before;
    powers[0] = change;
    powers[1] = h * rates[0] - change;
    powers[2] = 2 * change - h * (rates[Tableau::stages] + rates[0]);
    for (int i = 3; i < Tableau::powers; ++i)
    {
      powers[i].setZero(change.size());
      for (int k = 0; k < Tableau::all; ++k)
        powers[i] += h * tableau.d[i - 3][k] * rates[k];
    }
    return powers;
  }

  // Fill the samples (count, n) after the first. Return the number of steps; -1 if a step would vanish, -2 after `most` steps.
  long run(const double * times, long count, double * samples_y, double * samples_dy, long most)
  {
    Linkage & l = linkage;
    const long n = l.y.size();
    const double finish = times[count - 1];
    double t = times[0];
    long done = 1, steps = 0;
    l.velocities[0] = l.dy;
    l.accelerations[0] = l.acceleration(l.y, l.dy);
    double h = first_step(finish - t);
    while (done < count)
    {
      const double least = 10 * (std::nextafter(t, std::numeric_limits<double>::infinity()) - t);
      h = std::max(h, least);
      for (bool rejected = false;;)
      {
        if (h < least)
          return -1;
        const double end = std::min(t + h, finish);
        h = end - t;
        l.stages(tableau, h, 1, Tableau::stages);
        l.end_of_step(tableau, h, next_y, next_dy);
        const double norm = error(h);
        if (!std::isfinite(norm))
          return -1;
        if (norm < 1)
        {
          double factor = norm == 0 ? 10.0 : std::min(10.0, 0.9 * std::pow(norm, -1.0 / 8));
          if (rejected)
            factor = std::min(1.0, factor);
          l.velocities[Tableau::stages] = next_dy;
          l.accelerations[Tableau::stages] = l.acceleration(next_y, next_dy);
          const bool has_samples = done < count && times[done] <= end;
          if (has_samples && times[done] < end)
          {
            l.stages(tableau, h, Tableau::stages + 1, Tableau::all);
            const auto of_y = polynomial(l.velocities, l.y, next_y, h), of_dy = polynomial(l.accelerations, l.dy, next_dy, h);
            for (; done < count && times[done] < end; ++done)
            {
              const double x = (times[done] - t) / h;
              Eigen::Map<VectorXd>(samples_y + done * n, n) = inside(x, l.y, of_y);
              Eigen::Map<VectorXd>(samples_dy + done * n, n) = inside(x, l.dy, of_dy);
            }
          }
          for (; done < count && times[done] == end; ++done)
          {
            Eigen::Map<VectorXd>(samples_y + done * n, n) = next_y;
            Eigen::Map<VectorXd>(samples_dy + done * n, n) = next_dy;
          }
          l.y.swap(next_y);
          l.dy.swap(next_dy);
          l.velocities[0] = l.velocities[Tableau::stages];  // the last stage of a step is the first of the next
          l.accelerations[0] = l.accelerations[Tableau::stages];
          t = end;
          h *= factor;
          break;
        }
        h *= std::max(0.2, 0.9 * std::pow(norm, -1.0 / 8));
        rejected = true;
      }
      if (++steps > most)
        return -2;
    }
    return steps;
  }
};

extern "C"
{
  Linkage * create(const double * gravity)
  {
    auto * l = new Linkage;
    l->model.gravity.linear() = Eigen::Map<const Vector3d>(gravity);
    l->joints.resize(1);
    l->frames = {Frame{Vector2d::Zero(), 1.0, 0.0}};
    return l;
  }

  void destroy(Linkage * l) { delete l; }

  // Add a joint with one coordinate: a slide along the axis `kind` x or y, or for z a hinge. The body has its centre of mass at
  // `lever`, and the moments of inertia (3, 3) about it, row by row.
  void add_joint(Linkage * l, int parent, char kind, const double * at, double mass, const double * lever, const double * inertia)
  {
    const pin::SE3 where = placement(at);
    const std::string name = std::to_string(l->joints.size());
    const pin::JointIndex joint = kind == 'z'   ? l->model.addJoint(parent, pin::JointModelRZ(), where, name)
                                  : kind == 'x' ? l->model.addJoint(parent, pin::JointModelPX(), where, name)
                                                : l->model.addJoint(parent, pin::JointModelPY(), where, name);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> moments(inertia);
    l->model.appendBodyToJoint(joint, pin::Inertia(mass, Eigen::Map<const Vector3d>(lever), moments), pin::SE3::Identity());
    const Frame frame{pair(at), at[3], at[6]};  // the first column of the rotation is cosine and sine
    l->joints.push_back(Planar{frame, kind == 'z', kind == 'y' ? Vector2d(0, 1) : Vector2d(1, 0)});
    l->frames.push_back(frame);
  }

  void add_closure(Linkage * l, int first, const double * at_first, int second, const double * at_second, const double * gains)
  {
    pin::RigidConstraintModel row(
      pin::CONTACT_3D, l->model, first, placement(at_first), second, placement(at_second), pin::LOCAL_WORLD_ALIGNED);
    row.m_baumgarte_parameters.Kp = gains[0];
    row.m_baumgarte_parameters.Kd = gains[1];
    l->closures.push_back(row);
  }

  // An `axis` of zeros means that there is none: the spring acts along the line between its points.
  void add_spring(Linkage * l, int a, const double * at_a, int b, const double * at_b, const double * axis, const double * law)
  {
    const bool has_axis = axis[0] != 0 || axis[1] != 0;
    l->springs.push_back(Spring{{a, pair(at_a)}, {b, pair(at_b)}, has_axis, pair(axis), law[0], law[1], law[2], law[3]});
  }

  void add_push(Linkage * l, int joint, const double * at, int frame, const double * value)
  {
    l->pushes.push_back(Push{{joint, pair(at)}, frame, pair(value)});
  }

  // Complete a linkage that has all joints and closures: set the affine forces, and the accuracy of Pinocchio's solver.
  void finish(Linkage * l, const double * constant, const double * stiffness, const double * damping,
              const double * accuracies, double mu, int iterations, double solved)
  {
    const int n = l->model.nv;
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    l->constant = Eigen::Map<const VectorXd>(constant, n);
    l->stiffness = Eigen::Map<const Rows>(stiffness, n, n);
    l->damping = Eigen::Map<const Rows>(damping, n, n);
    l->has_stiffness = !l->stiffness.isZero(0);
    l->has_damping = !l->damping.isZero(0);
    l->data = pin::Data(l->model);
    for (const auto & row : l->closures)
      l->closure_data.emplace_back(row);
    pin::initConstraintDynamics(l->model, l->data, l->closures, l->closure_data);
    l->proximal = pin::ProximalSettings(accuracies[0], accuracies[1], mu, iterations);
    l->solved = solved;
    for (VectorXd * x : {&l->tau, &l->y, &l->dy, &l->trial, &l->speeds_after, &l->a1, &l->a2, &l->a3, &l->a4, &l->v2, &l->v3, &l->v4})
      x->setZero(n);
    l->accelerations.assign(Tableau::all, VectorXd::Zero(n));
    l->velocities.assign(Tableau::all, VectorXd::Zero(n));
  }

  static bool copy_state(const Linkage * l, double * y, double * dy, bool reached)
  {
    Eigen::Map<VectorXd>(y, l->y.size()) = l->y;
    Eigen::Map<VectorXd>(dy, l->dy.size()) = l->dy;
    return reached;
  }

  static void set(Linkage * l, const double * y, const double * dy)
  {
    l->y = Eigen::Map<const VectorXd>(y, l->model.nv);
    l->dy = Eigen::Map<const VectorXd>(dy, l->model.nv);
  }

  bool accelerate(Linkage * l, double * y, double * dy, double * a)
  {
    set(l, y, dy);
    try
    {
      Eigen::Map<VectorXd>(a, l->model.nv) = l->acceleration(l->y, l->dy);
      return true;
    }
    catch (const Failure &)
    {
      return copy_state(l, y, dy, false);
    }
  }

  // Take `count` equal steps of h from y, dy, which are overwritten by the state at the end. If there are no valid accelerations at
  // a stage, return false, with the state of this stage in y, dy.
  bool advance(Linkage * l, int method, const Tableau * tableau, double h, long count, double * y, double * dy)
  {
    set(l, y, dy);
    try
    {
      for (long k = 0; k < count; ++k)
        if (method == 0)
          l->rk4(h);
        else if (method == 1)
          l->semi_implicit_euler(h);
        else
          l->dop853_fixed(*tableau, h);
    }
    catch (const Failure &)
    {
      return copy_state(l, y, dy, false);
    }
    return copy_state(l, y, dy, true);
  }

  // Fill the samples (count, n) at `times`, of which the first is given. Return the number of steps, or -1 or -2 from
  // `Adaptive::run`, or -3 after a failure.
  long advance_adaptive(Linkage * l, const Tableau * tableau, const double * tolerances, const double * times, long count,
                        long most, double * y, double * dy, double * samples_y, double * samples_dy)
  {
    set(l, y, dy);
    try
    {
      Adaptive adaptive{*l, *tableau, tolerances[0], tolerances[1], {}, {}, {}, {}, {}, {}, {}, {}};
      return adaptive.run(times, count, samples_y, samples_dy, most);
    }
    catch (const Failure &)
    {
      copy_state(l, y, dy, false);
      return -3;
    }
  }

  // Return the number of evaluations since the last call.
  long evaluations(Linkage * l)
  {
    const long count = l->evaluations;
    l->evaluations = 0;
    return count;
  }
}
