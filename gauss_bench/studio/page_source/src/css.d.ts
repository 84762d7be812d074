// Lets TypeScript accept imports of style sheets, which the bundler copies.
declare module "*.css";
