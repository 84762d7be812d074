/* A crank-slider in its crank's angle th: J w' + H w^2 = Q.

   Numbers (SI) come before this file: pivot (OX, OY), crank R, rod L, the height E of the slider's pin, SIDE = sign of cos(phi);
   inertia J1 of the crank about its pivot, rod M2, I2 with its centre (A2, B2) from the crank's pin in its own frame, slider M3;
   gravity (GX, GY), weight moments of the crank W1C, W1S; constant torque T, damping D on the crank; spring K, C, X0 on the slider. */

#include <math.h>

/* s, c and sp, cp: sine and cosine of th and of the rod's angle phi; p, pp: first and second derivative of phi by th; x, y: the
   rod's centre; b: the x coordinate of the slider's pin; xp, xpp and so on: first and second derivatives by th */
typedef struct { double s, c, sp, cp, p, pp, x, y, xp, yp, xpp, ypp, b, bp, bpp; } Pose;

static inline Pose pose(double th)
{
    Pose o;
    o.s = sin(th);
    o.c = cos(th);
    o.sp = (E - OY - R * o.s) / L;                    /* the rod's angle phi closes the loop */
    o.cp = SIDE * sqrt(1 - o.sp * o.sp);
    double inverse = 1 / (L * o.cp);
    o.p = -R * o.c * inverse;                         /* dphi/dth */
    o.pp = (R * o.s + L * o.sp * o.p * o.p) * inverse;
    double ux = A2 * o.cp - B2 * o.sp, uy = A2 * o.sp + B2 * o.cp;
    o.x = OX + R * o.c + ux;                          /* the rod's centre and its derivatives by th */
    o.y = OY + R * o.s + uy;
    o.xp = -R * o.s - o.p * uy;
    o.yp = R * o.c + o.p * ux;
    o.xpp = -R * o.c - o.pp * uy - o.p * o.p * ux;
    o.ypp = -R * o.s + o.pp * ux - o.p * o.p * uy;
    o.b = OX + R * o.c + L * o.cp;                    /* the slider's pin */
    o.bp = -R * o.s - L * o.sp * o.p;
    o.bpp = -R * o.c - L * (o.cp * o.p * o.p + o.sp * o.pp);
    return o;
}

static void acceleration(double t, const double *q, const double *v, double *a)
{
    Pose o = pose(q[0]);
    double w = v[0];
    double J = J1 + M2 * (o.xp * o.xp + o.yp * o.yp) + I2 * o.p * o.p + M3 * o.bp * o.bp;
    double H = M2 * (o.xp * o.xpp + o.yp * o.ypp) + I2 * o.p * o.pp + M3 * o.bp * o.bpp;
    double Q = T - D * w + W1C * o.c - W1S * o.s + M2 * (GX * o.xp + GY * o.yp) + M3 * GX * o.bp
        + (K * (X0 - o.b) - C * o.bp * w) * o.bp;
    a[0] = (Q - H * w * w) / J;
}

/* The angles of the rod's line and of the slider. */
void line_angles(double th, double *out)
{
    Pose o = pose(th);
    out[0] = atan2(o.sp, o.cp);
    out[1] = 0;
}
