/* A four-bar in its crank's angle th: J w' + H w^2 = Q.

   Numbers (SI) come before this file: pivots (OX, OY) and (DX, DY), crank R, coupler L, rocker S, the sign SIDE of the
   closure; inertias J1, J3 of crank and rocker about their pivots; coupler M2, I2 with its centre (A2, B2) from the crank's pin in
   the frame along the coupler; gravity (GX, GY), weight moments of the crank W1C, W1S and of the rocker W3C, W3S; constant torque
   T and damping D on the crank. */

#include <math.h>

/* s, c; sp, cp; sr, cr: sine and cosine of th, of the coupler's angle phi and of the rocker's angle psi; p, pp and r, rp: first and
   second derivatives of phi and psi by th; x, y: the coupler's centre; xp, xpp and so on: first and second derivatives by th */
typedef struct { double s, c, sp, cp, sr, cr, p, pp, r, rp, x, y, xp, yp, xpp, ypp; } Pose;

static inline Pose pose(double th)
{
    Pose o;
    o.s = sin(th);
    o.c = cos(th);
    double ex = DX - OX - R * o.c, ey = DY - OY - R * o.s, d = ex * ex + ey * ey;     /* from the crank's pin to the far pivot */
    double k = (d + L * L - S * S) / (2 * d * L), m = SIDE * sqrt(1 / d - k * k);     /* the coupler in units of that vector */
    o.cp = k * ex - m * ey;
    o.sp = k * ey + m * ex;
    o.cr = (L * o.cp - ex) / S;
    o.sr = (L * o.sp - ey) / S;
    double cross = 1 / (o.sp * o.cr - o.cp * o.sr);                                   /* 1 / sin(phi - psi) */
    o.p = R / L * (o.sr * o.c - o.cr * o.s) * cross;                                  /* dphi/dth, dpsi/dth */
    o.r = R / S * (o.sp * o.c - o.cp * o.s) * cross;
    double dot = o.cp * o.cr + o.sp * o.sr, lp = L * o.p * o.p, sr = S * o.r * o.r;
    o.pp = (sr - R * (o.c * o.cr + o.s * o.sr) - lp * dot) * cross / L;
    o.rp = (sr * dot - R * (o.c * o.cp + o.s * o.sp) - lp) * cross / S;
    double ux = A2 * o.cp - B2 * o.sp, uy = A2 * o.sp + B2 * o.cp;
    o.x = OX + R * o.c + ux;                                                          /* the coupler's centre */
    o.y = OY + R * o.s + uy;
    o.xp = -R * o.s - o.p * uy;
    o.yp = R * o.c + o.p * ux;
    o.xpp = -R * o.c - o.pp * uy - o.p * o.p * ux;
    o.ypp = -R * o.s + o.pp * ux - o.p * o.p * uy;
    return o;
}

static void acceleration(double t, const double *q, const double *v, double *a)
{
    Pose o = pose(q[0]);
    double w = v[0];
    double J = J1 + M2 * (o.xp * o.xp + o.yp * o.yp) + I2 * o.p * o.p + J3 * o.r * o.r;
    double H = M2 * (o.xp * o.xpp + o.yp * o.ypp) + I2 * o.p * o.pp + J3 * o.r * o.rp;
    double Q = T - D * w + W1C * o.c - W1S * o.s + M2 * (GX * o.xp + GY * o.yp) + (W3C * o.cr - W3S * o.sr) * o.r;
    a[0] = (Q - H * w * w) / J;
}

/* The angles of the lines of coupler and rocker. */
void line_angles(double th, double *out)
{
    Pose o = pose(th);
    out[0] = atan2(o.sp, o.cp);
    out[1] = atan2(o.sr, o.cr);
}
